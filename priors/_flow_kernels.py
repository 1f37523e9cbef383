"""Averages of frames along their motion: warping and averaging in one pass over each frame."""

import numba
import numpy as np

from pnp_sci._jit import kernel, loop

FRACTION = 64  # flow is stored in 64ths of a pixel, as int16: half the memory of float32, and finer than flows are true


def _catmull_rom(t: np.ndarray) -> np.ndarray:
    """Weights (..., 4) of Catmull-Rom interpolation at the fraction t between the middle two of four samples."""
    before, after = ((-0.5 * t + 1.0) * t - 0.5) * t, (0.5 * t - 0.5) * t * t
    here, there = (1.5 * t - 2.5) * t * t + 1.0, ((-1.5 * t + 2.0) * t + 0.5) * t
    return np.stack([before, here, there, after], -1).astype(np.float32)


CUBIC = _catmull_rom(np.arange(FRACTION) / FRACTION)


@loop
def extend(frame, out):
    """out <- the frame and, around it, what bicubic interpolation reads: a pixel before, two behind, all as it ends."""
    rows, columns = frame.shape
    for i in range(rows + 3):
        o = out[i]
        o[1 : columns + 1] = frame[min(max(i - 1, 0), rows - 1)]
        o[0] = o[1]
        o[columns + 1 :] = o[columns]


@loop
def warp(extended, flow, i, out):
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
        extend(v[b], extended[b])
    for b in numba.prange(frames):
        warped, total = np.empty(columns, v.dtype), np.empty(columns, v.dtype)
        for i in range(rows):
            o = out[b, i]
            o[:] = v[b, i] * v.dtype.type(255)
            total[:] = 255
            for p in range(first[b], first[b + 1]):
                warp(extended[pairs[p, 1]], flow[p, i], i, warped)
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
