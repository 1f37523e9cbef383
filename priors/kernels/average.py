"""Motion-compensated averages of frames: warping and averaging in one pass over each frame."""

import numba
import numpy as np

from pnp_sci.accel.jit import device_function, kernel, loop

FRACTION = 64  # units of flow per pixel; int16 has half the memory of float32


def _catmull_rom(t: np.ndarray) -> np.ndarray:
    """Weights (..., 4) of Catmull-Rom interpolation at the fraction t between the two middle samples of four."""
    before, after = ((-0.5 * t + 1.0) * t - 0.5) * t, (0.5 * t - 0.5) * t * t
    here, there = (1.5 * t - 2.5) * t * t + 1.0, ((-1.5 * t + 2.0) * t + 0.5) * t
    return np.stack([before, here, there, after], -1).astype(np.float32)


CUBIC = _catmull_rom(np.arange(FRACTION) / FRACTION)


@loop
def extend(frame, out):
    """out (H + 4, W + 4) <- the frame (H, W), padded by replication: one pixel before and three after, each axis."""
    rows, columns = frame.shape
    for i in range(rows + 4):
        o = out[i]
        o[1 : columns + 1] = frame[min(max(i - 1, 0), rows - 1)]
        o[0] = o[1]
        o[columns + 1 :] = o[columns]


@device_function
def _column(pixels, k, row, weights):
    """Interpolate five pixels of a column, from k on: between the second and third, and the third and fourth."""
    u = np.uint64
    w0, w1, w2, w3 = weights[u(0)], weights[u(1)], weights[u(2)], weights[u(3)]
    p0, p1, p2 = pixels[k], pixels[k + row], pixels[k + u(2) * row]
    p3, p4 = pixels[k + u(3) * row], pixels[k + u(4) * row]
    return w0 * p0 + w1 * p1 + w2 * p2 + w3 * p3, w0 * p1 + w1 * p2 + w2 * p3 + w3 * p4


@loop
def _warp_blocks(extended, flow, i, upper_even, upper_odd, lower_even, lower_odd):
    """Warp a frame by the flow of blocks of 2 x 2 pixels, bicubic, for rows 2 i (upper) and 2 i + 1 (lower).

    Even and odd columns are separate arrays (W / 2,). The four pixels of a block share most of their reads, which
    halves the time. The position of the first pixel is clamped to the frame, and the others follow it.
    Indices are unsigned integers, for which numba emits no test of the sign.
    """
    u, real = np.uint64, upper_even.dtype.type
    rows, columns, row = extended.shape[0] - 4, extended.shape[1] - 4, u(extended.shape[1])
    pixels = extended.reshape(-1)
    for j in range(upper_even.size):
        y = u(min(max(2 * i * FRACTION + flow[j, 1], 0), (rows - 1) * FRACTION))
        x = u(min(max(2 * j * FRACTION + flow[j, 0], 0), (columns - 1) * FRACTION))
        down, across = CUBIC[y % u(FRACTION)], CUBIC[x % u(FRACTION)]
        k = y // u(FRACTION) * row + x // u(FRACTION)
        first_upper, first_lower = _column(pixels, k, row, down)
        last_upper, last_lower = _column(pixels, k + u(4), row, down)
        even = across[u(0)] * first_upper, across[u(0)] * first_lower
        odd = across[u(3)] * last_upper, across[u(3)] * last_lower
        for c in range(u(1), u(4)):
            upper, lower = _column(pixels, k + c, row, down)
            even = even[0] + across[c] * upper, even[1] + across[c] * lower
            odd = odd[0] + across[c - u(1)] * upper, odd[1] + across[c - u(1)] * lower
        upper_even[j], lower_even[j] = real(even[0]), real(even[1])
        upper_odd[j], lower_odd[j] = real(odd[0]), real(odd[1])


@loop
def _add(even, odd, share, total, out):
    """out <- out + share * warped, total <- total + share; `even` and `odd` are the columns of the warped row."""
    pairs = out.size // 2
    for j in range(pairs):
        v, w = out.dtype.type(share[2 * j]), out.dtype.type(share[2 * j + 1])
        total[2 * j] += v
        total[2 * j + 1] += w
        out[2 * j] += v * even[j]
        out[2 * j + 1] += w * odd[j]
    for j in range(2 * pairs, out.size):
        w = out.dtype.type(share[j])
        total[j] += w
        out[j] += w * even[pairs]


@kernel
def average(v, flow, weights, pairs, first, out):
    """out <- each frame of v (B, H, W) averaged with its warped neighbours; the frame itself has weight 255.

    pairs[first[b]:first[b + 1]] are the pairs (b, n) of frame b; flow: (P, ceil(H / 2), ceil(W / 2), 2), one vector for
    2 x 2 pixels, in 1/FRACTION pixel; weights: (P, H, W), uint8.
    """
    frames, rows, columns = v.shape
    extended = np.empty((frames, rows + 4, columns + 4), v.dtype)
    for b in numba.prange(frames):
        extend(v[b], extended[b])
    for b in numba.prange(frames):
        warped, total = np.empty((2, 2, (columns + 1) // 2), v.dtype), np.empty((2, columns), v.dtype)
        for top in range(0, rows, 2):
            here = range(top, min(top + 2, rows))
            total[:] = 255
            for i in here:
                out[b, i] = v[b, i] * v.dtype.type(255)
            for p in range(first[b], first[b + 1]):
                there, half = extended[pairs[p, 1]], top // 2
                _warp_blocks(there, flow[p, half], half, warped[0, 0], warped[0, 1], warped[1, 0], warped[1, 1])
                for i in here:
                    _add(warped[i - top, 0], warped[i - top, 1], weights[p, i], total[i - top], out[b, i])
            for i in here:
                out[b, i] /= total[i - top]


@device_function
def _scatter(extended, share, flow):
    """extended <- extended + transpose of :func:`_warp_blocks` for a frame of shares (H, W)."""
    rows, columns = share.shape
    for i in range(rows):
        for j in range(columns):
            s = share[i, j]
            if s == 0:
                continue
            first_row, first_column = i - i % 2, j - j % 2
            y = min(max(first_row * FRACTION + flow[i // 2, j // 2, 1], 0), (rows - 1) * FRACTION)
            x = min(max(first_column * FRACTION + flow[i // 2, j // 2, 0], 0), (columns - 1) * FRACTION)
            top, left = y // FRACTION + i % 2, x // FRACTION + j % 2
            for a in range(4):
                down = s * CUBIC[y % FRACTION, a]
                for c in range(4):
                    extended[top + a, left + c] += down * CUBIC[x % FRACTION, c]


@kernel
def spread(g, flow, weights, pairs, first, out):
    """out (B, H, W) <- the transpose of :func:`average` applied to g (B, H, W), for gradients."""
    frames, rows, columns = g.shape
    parts = np.empty_like(g)
    for b in numba.prange(frames):
        for i in range(rows):
            for j in range(columns):
                total = g.dtype.type(255)
                for p in range(first[b], first[b + 1]):
                    total += g.dtype.type(weights[p, i, j])
                parts[b, i, j] = g[b, i, j] / total
    for n in numba.prange(frames):
        extended, share = np.zeros((rows + 4, columns + 4), g.dtype), np.empty((rows, columns), g.dtype)
        for p in range(len(pairs)):
            if pairs[p, 1] == n:
                for i in range(rows):
                    for j in range(columns):
                        share[i, j] = parts[pairs[p, 0], i, j] * g.dtype.type(weights[p, i, j])
                _scatter(extended, share, flow[p])
        for i in range(rows):
            for j in range(columns):
                out[n, i, j] = g.dtype.type(255) * parts[n, i, j]
        for i in range(rows + 4):
            for j in range(columns + 4):  # the transpose of `extend`
                out[n, min(max(i - 1, 0), rows - 1), min(max(j - 1, 0), columns - 1)] += extended[i, j]


@kernel
def remaining(weights, first, left):
    """left (B, H, W) <- factor of averages with these weights (P, H, W) on the standard deviation of white noise."""
    frames, rows, columns = left.shape
    real = left.dtype.type
    for b in numba.prange(frames):
        total, squares = np.empty(columns, left.dtype), np.empty(columns, left.dtype)
        for i in range(rows):
            total[:], squares[:] = 1, 1
            for p in range(first[b], first[b + 1]):
                for j in range(columns):
                    w = real(weights[p, i, j]) / real(255)
                    total[j] += w
                    squares[j] += w * w
            left[b, i] = np.sqrt(squares) / total
