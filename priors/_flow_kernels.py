"""Averages of frames along their motion: warping, comparing and weighting in one pass over each frame."""

import numba
import numpy as np

from pnp_sci._jit import device_function, kernel, loop

FRACTION = 64  # flow is stored in 64ths of a pixel, as int16: half the memory of float32, and finer than flows are true
SMOOTH = 3  # pixels either side of the box that averages squared differences, applied twice: a Gaussian of 2.8 pixels


def _catmull_rom(t: np.ndarray) -> np.ndarray:
    """Weights (..., 4) of Catmull-Rom interpolation at the fraction t between the middle two of four samples."""
    before, after = ((-0.5 * t + 1.0) * t - 0.5) * t, (0.5 * t - 0.5) * t * t
    here, there = (1.5 * t - 2.5) * t * t + 1.0, ((-1.5 * t + 2.0) * t + 0.5) * t
    return np.stack([before, here, there, after], -1).astype(np.float32)


CUBIC = _catmull_rom(np.arange(FRACTION) / FRACTION)
STEPS = 2048  # of an exponent from 0 to 1
FADING = (255 * np.exp(-np.arange(np.ceil(STEPS * np.log(255))) / STEPS)).astype(np.uint8)  # as long as it is 1 or more


@loop
def _extend(frame, out):
    """out <- the frame and, around it, what bicubic interpolation reads: a pixel before, two behind, all as it ends."""
    rows, columns = frame.shape
    for i in range(rows + 3):
        o = out[i]
        o[1 : columns + 1] = frame[min(max(i - 1, 0), rows - 1)]
        o[0] = o[1]
        o[columns + 1 :] = o[columns]


@loop
def _warp(extended, flow, i, out):
    """out[j] <- frame[i + flow rows, j + flow columns], bicubic, for a row i; the frame goes on as it ends.

    Pixels are counted from the first one by unsigned integers, which numba does not check for being negative.
    """
    u, real = np.uint64, out.dtype.type
    rows, columns, row = extended.shape[0] - 3, out.size, u(extended.shape[1])
    pixels = extended.reshape(-1)
    for j in range(columns):
        y = u(min(max(i * FRACTION + flow[j, 1], 0), (rows - 1) * FRACTION))
        x = u(min(max(j * FRACTION + flow[j, 0], 0), (columns - 1) * FRACTION))
        wr, wc = CUBIC[y % u(FRACTION)], CUBIC[x % u(FRACTION)]
        corner = y // u(FRACTION) * row + x // u(FRACTION)
        total = real(0)
        for b in range(u(4)):
            k = corner + b
            below = wr[u(0)] * pixels[k] + wr[u(1)] * pixels[k + row]
            below += wr[u(2)] * pixels[k + u(2) * row] + wr[u(3)] * pixels[k + u(3) * row]
            total += wc[b] * below
        out[j] = total


@device_function
def _box(picture, scratch):
    """Mean over a square of 2 SMOOTH + 1 pixels, in place; the picture goes on beyond its edges as it ends."""
    rows, columns = picture.shape
    scale = picture.dtype.type(1.0 / (2 * SMOOTH + 1) ** 2)
    below = np.zeros(columns + 2 * SMOOTH, picture.dtype)  # sums over rows, the ends of the row repeated
    for i in range(rows):
        scratch[i] = picture[i]
    for d in range(-SMOOTH, SMOOTH + 1):
        k = min(max(d, 0), rows - 1)
        for j in range(columns):
            below[j + SMOOTH] += scratch[k, j]
    for i in range(rows):
        below[:SMOOTH] = below[SMOOTH]
        below[columns + SMOOTH :] = below[columns + SMOOTH - 1]
        o = picture[i]
        o[:] = 0
        for d in range(2 * SMOOTH + 1):
            shifted = below[d : d + columns]
            for j in range(columns):
                o[j] += shifted[j]
        enter, leave = min(i + SMOOTH + 1, rows - 1), max(i - SMOOTH, 0)
        for j in range(columns):
            o[j] *= scale
            below[j + SMOOTH] += scratch[enter, j] - scratch[leave, j]


@kernel
def consistency(flow, pairs, reverse, tolerance, trust):
    """trust[p] <- 255 exp(-|flow there + flow back|^2 / tolerance^2) for each pair of frames, as uint8."""
    rows, columns = flow.shape[1:3]
    scale = STEPS / (FRACTION * tolerance) ** 2
    for p in numba.prange(len(pairs)):
        there, back = flow[p], flow[reverse[p]]
        for i in range(rows):
            for j in range(columns):
                y = i + (there[i, j, 1] + FRACTION // 2) // FRACTION
                x = j + (there[i, j, 0] + FRACTION // 2) // FRACTION
                trust[p, i, j] = 0
                if 0 <= y < rows and 0 <= x < columns:
                    dy, dx = there[i, j, 1] + back[y, x, 1], there[i, j, 0] + back[y, x, 0]
                    step = (dy * dy + dx * dx) * scale
                    if step < len(FADING):
                        trust[p, i, j] = FADING[np.int64(step)]


@kernel
def weigh(v, flow, trust, pairs, tolerance, weights):
    """weights[p] <- trust[p] exp(-z) for each pair (b, n) of frames of v (B, H, W), as uint8.

    z is the squared difference of frame n, warped, from frame b, smoothed, over tolerance^2; exp(z) by its first terms.
    """
    frames, rows, columns = v.shape
    one, half, sixth = v.dtype.type(1), v.dtype.type(1 / 2), v.dtype.type(1 / 6)
    inverse = one / (tolerance * tolerance)
    extended = np.empty((frames, rows + 3, columns + 3), v.dtype)
    for b in numba.prange(frames):
        _extend(v[b], extended[b])
    for p in numba.prange(len(pairs)):
        here, there = v[pairs[p, 0]], extended[pairs[p, 1]]
        distance, scratch = np.empty_like(here), np.empty_like(here)
        for i in range(rows):
            d = distance[i]
            _warp(there, flow[p, i], i, d)
            for j in range(columns):
                d[j] = (d[j] - here[i, j]) ** 2
        _box(distance, scratch)
        _box(distance, scratch)
        for i in range(rows):
            for j in range(columns):
                z = max(distance[i, j], v.dtype.type(0)) * inverse
                weights[p, i, j] = np.uint8(trust[p, i, j] / (one + z * (one + z * (half + z * sixth))))


@loop
def _add(warped, share, total, out):
    """out <- out + share * warped, total <- total + share."""
    for j in range(out.size):
        w = out.dtype.type(share[j])
        total[j] += w
        out[j] += w * warped[j]


@kernel
def average(v, flow, weights, pairs, first, out):
    """Each frame of v (B, H, W) averaged with its neighbours, warped onto it; the frame itself weighs 255.

    pairs[first[b]:first[b + 1]] are those (b, n) of frame b.
    """
    frames, rows, columns = v.shape
    extended = np.empty((frames, rows + 3, columns + 3), v.dtype)
    for b in numba.prange(frames):
        _extend(v[b], extended[b])
    for b in numba.prange(frames):
        warped, total = np.empty(columns, v.dtype), np.empty(columns, v.dtype)
        for i in range(rows):
            o = out[b, i]
            o[:] = v[b, i] * v.dtype.type(255)
            total[:] = 255
            for p in range(first[b], first[b + 1]):
                _warp(extended[pairs[p, 1]], flow[p, i], i, warped)
                _add(warped, weights[p, i], total, o)
            o /= total


@kernel
def remaining(weights, first, left):
    """left (B, H, W) <- what averages by these weights leave of the standard deviation of white noise."""
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
