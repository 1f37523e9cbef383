"""Averages of frames along their motion: warping, comparing and weighting in one pass over each frame."""

import numba
import numpy as np

from pnp_sci._jit import device_function, kernel

FRACTION = 64  # flow is stored in 64ths of a pixel, as int16: half the memory of float32, and finer than flows are true
SMOOTH = 3  # pixels either side of the box that averages squared differences, applied twice: a Gaussian of 2.8 pixels


def _catmull_rom(t: np.ndarray) -> np.ndarray:
    """Weights (..., 4) of Catmull-Rom interpolation at the fraction t between the middle two of four samples."""
    before, after = ((-0.5 * t + 1.0) * t - 0.5) * t, (0.5 * t - 0.5) * t * t
    here, there = (1.5 * t - 2.5) * t * t + 1.0, ((-1.5 * t + 2.0) * t + 0.5) * t
    return np.stack([before, here, there, after], -1).astype(np.float32)


CUBIC = _catmull_rom(np.arange(FRACTION) / FRACTION)


@device_function
def _warp(frame, flow, out):
    """out[i, j] <- frame[i + flow rows, j + flow columns], bicubic; the frame goes on beyond its edges as it ends.

    Inside, pixels are counted from the first one by unsigned integers, which numba does not check for being negative.
    """
    rows, columns = frame.shape
    pixels, row, u = frame.reshape(-1), np.uint64(columns), np.uint64
    for i in range(rows):
        for j in range(columns):
            y = min(max(i * FRACTION + flow[i, j, 1], 0), (rows - 1) * FRACTION)
            x = min(max(j * FRACTION + flow[i, j, 0], 0), (columns - 1) * FRACTION)
            r, c = y // FRACTION, x // FRACTION
            wr, wc = CUBIC[u(y - r * FRACTION)], CUBIC[u(x - c * FRACTION)]
            total = frame.dtype.type(0)
            if 0 < r < rows - 2 and 0 < c < columns - 2:
                corner = u((r - 1) * columns + c - 1)
                for b in range(u(4)):
                    k = corner + b
                    below = wr[u(0)] * pixels[k] + wr[u(1)] * pixels[k + row]
                    below += wr[u(2)] * pixels[k + u(2) * row] + wr[u(3)] * pixels[k + u(3) * row]
                    total += wc[b] * below
            else:
                for a in range(4):
                    ra = min(max(r + a - 1, 0), rows - 1)
                    for b in range(4):
                        total += wr[a] * wc[b] * frame[ra, min(max(c + b - 1, 0), columns - 1)]
            out[i, j] = total


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
    for p in numba.prange(len(pairs)):
        back = flow[reverse[p]]
        for i in range(rows):
            for j in range(columns):
                y = i + (flow[p, i, j, 1] + FRACTION // 2) // FRACTION
                x = j + (flow[p, i, j, 0] + FRACTION // 2) // FRACTION
                if 0 <= y < rows and 0 <= x < columns:
                    dy = (flow[p, i, j, 1] + back[y, x, 1]) / FRACTION
                    dx = (flow[p, i, j, 0] + back[y, x, 0]) / FRACTION
                    trust[p, i, j] = np.uint8(255 * np.exp(-(dy * dy + dx * dx) / (tolerance * tolerance)))
                else:
                    trust[p, i, j] = 0


@kernel
def weigh(v, flow, trust, pairs, tolerance, weights):
    """weights[p] <- trust[p] exp(-z) for each pair (b, n) of frames of v (B, H, W), as uint8.

    z is the squared difference of frame n, warped, from frame b, smoothed, over tolerance^2; exp(z) by its first terms.
    """
    rows, columns = v.shape[1:]
    one, half, sixth = v.dtype.type(1), v.dtype.type(1 / 2), v.dtype.type(1 / 6)
    inverse = one / (tolerance * tolerance)
    for p in numba.prange(len(pairs)):
        here = v[pairs[p, 0]]
        distance, scratch = np.empty_like(here), np.empty_like(here)
        _warp(v[pairs[p, 1]], flow[p], distance)
        for i in range(rows):
            for j in range(columns):
                d = distance[i, j] - here[i, j]
                distance[i, j] = d * d
        _box(distance, scratch)
        _box(distance, scratch)
        for i in range(rows):
            for j in range(columns):
                z = max(distance[i, j], v.dtype.type(0)) * inverse
                weights[p, i, j] = np.uint8(trust[p, i, j] / (one + z * (one + z * (half + z * sixth))))


@kernel
def average(v, flow, weights, pairs, first, out):
    """Each frame of v (B, H, W) averaged with its neighbours, warped onto it; the frame itself weighs 255.

    pairs[first[b]:first[b + 1]] are those (b, n) of frame b.
    """
    frames, rows, columns = v.shape
    for b in numba.prange(frames):
        warped = np.empty_like(v[b])
        weight = np.full_like(v[b], 255)
        out[b] = v[b] * v.dtype.type(255)
        for p in range(first[b], first[b + 1]):
            _warp(v[pairs[p, 1]], flow[p], warped)
            for i in range(rows):
                for j in range(columns):
                    w = v.dtype.type(weights[p, i, j])
                    weight[i, j] += w
                    out[b, i, j] += w * warped[i, j]
        out[b] /= weight
