"""Matching of frames along a flow: squared differences, choice between two flows, and weights of neighbours."""

import numba
import numpy as np

from pnp_sci.accel.jit import device_function, kernel, loop
from priors.kernels.average import CUBIC, FRACTION, extend

NEAR = 1  # pixels: half width of the box over squared differences; applied twice, about a Gaussian of 1.2 pixels
WIDE = 2  # pixels: half width of the box over flow; applied twice, about a Gaussian of 2 pixels
STEPS = 2048  # entries of FADING per unit of the exponent
FADING = (255 * np.exp(-np.arange(np.ceil(STEPS * np.log(255))) / STEPS)).astype(np.uint8)  # 255 exp(-x) while >= 1
LIMIT = np.iinfo(np.int16).max  # largest flow, in 1/FRACTION pixel


@device_function
def _box(picture, reach, scratch):
    """Mean over a square of 2 reach + 1 pixels, in place, with edges replicated."""
    rows, columns = picture.shape
    scale = picture.dtype.type(1.0 / (2 * reach + 1) ** 2)
    below = np.zeros(columns + 2 * reach, picture.dtype)  # sums over rows, with edges replicated
    for i in range(rows):
        scratch[i] = picture[i]
    for d in range(-reach, reach + 1):
        k = min(max(d, 0), rows - 1)
        for j in range(columns):
            below[j + reach] += scratch[k, j]
    for i in range(rows):
        below[:reach] = below[reach]
        below[columns + reach :] = below[columns + reach - 1]
        o = picture[i]
        o[:] = 0
        for d in range(2 * reach + 1):
            shifted = below[d : d + columns]
            for j in range(columns):
                o[j] += shifted[j]
        enter, leave = min(i + reach + 1, rows - 1), max(i - reach, 0)
        for j in range(columns):
            o[j] *= scale
            below[j + reach] += scratch[enter, j] - scratch[leave, j]


@loop
def _warp_row(extended, flow, i, out):
    """out[j] <- frame[i + flow rows, j + flow columns], bicubic, for row i, with edges replicated.

    `extended` is the frame padded by :func:`priors.kernels.average.extend`. Indices are unsigned integers, for which
    numba emits no test of the sign.
    """
    u, real = np.uint64, out.dtype.type
    rows, columns, row = extended.shape[0] - 4, out.size, u(extended.shape[1])
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
def _differ(here, there, flow, distance, scratch):
    """distance <- smoothed squared difference between frame `here` and the padded frame `there`, warped by `flow`."""
    for i in range(len(here)):
        d = distance[i]
        _warp_row(there, flow[i], i, d)
        for j in range(d.size):
            d[j] = (d[j] - here[i, j]) ** 2
    _box(distance, NEAR, scratch)
    _box(distance, NEAR, scratch)


@kernel
def differ(v, flow, pairs, distance):
    """distance[p] <- smoothed squared difference between frame b of v (B, H, W) and frame n, warped, for each pair."""
    frames, rows, columns = v.shape
    extended = np.empty((frames, rows + 4, columns + 4), v.dtype)
    for b in numba.prange(frames):
        extend(v[b], extended[b])
    for p in numba.prange(len(pairs)):
        here, there = v[pairs[p, 0]], extended[pairs[p, 1]]
        _differ(here, there, flow[p], distance[p], np.empty_like(here))


@kernel
def choose(v, candidate, favour, pairs, flow, distance):
    """flow[p], distance[p] <- those of the candidate where its distance is below `favour` times distance[p]."""
    frames, rows, columns = v.shape
    extended = np.empty((frames, rows + 4, columns + 4), v.dtype)
    for b in numba.prange(frames):
        extend(v[b], extended[b])
    for p in numba.prange(len(pairs)):
        here, there = v[pairs[p, 0]], extended[pairs[p, 1]]
        other = np.empty_like(here)
        _differ(here, there, candidate[p], other, np.empty_like(here))
        for i in range(rows):
            for j in range(columns):
                if other[i, j] < favour * distance[p, i, j]:
                    distance[p, i, j] = other[i, j]
                    flow[p, i, j, 0], flow[p, i, j, 1] = candidate[p, i, j, 0], candidate[p, i, j, 1]


@kernel
def steady(flow, source, share, out):
    """out[p] <- share[p] flow[source[p]]: the flow of a pair if the motion between frames is steady."""
    for p in numba.prange(len(source)):
        given, scaled = flow[source[p]].reshape(-1), out[p].reshape(-1)
        for k in range(given.size):
            scaled[k] = np.int16(min(max(np.rint(share[p] * given[k]), -LIMIT), LIMIT))


@kernel
def smooth(flow, distance, tolerance, out):
    """out[p] <- weighted mean of flow[p] over a neighbourhood; the weight falls with distance / tolerance^2."""
    rows, columns = distance.shape[1:]
    one, inverse = distance.dtype.type(1), distance.dtype.type(1) / (tolerance * tolerance)
    least = distance.dtype.type(1e-6)  # rounding error of running sums in float32
    for p in numba.prange(len(flow)):
        scratch, total, part = np.empty_like(distance[p]), np.empty_like(distance[p]), np.empty_like(distance[p])
        sure = np.empty_like(total)
        for i in range(rows):
            for j in range(columns):
                z = one + max(distance[p, i, j], distance.dtype.type(0)) * inverse
                sure[i, j] = one / (z * z)
                total[i, j] = sure[i, j]
        _box(total, WIDE, scratch)
        _box(total, WIDE, scratch)
        for c in range(2):
            for i in range(rows):
                for j in range(columns):
                    part[i, j] = sure[i, j] * flow[p, i, j, c]
            _box(part, WIDE, scratch)
            _box(part, WIDE, scratch)
            for i in range(rows):
                for j in range(columns):
                    mean = np.rint(part[i, j] / max(total[i, j], least))
                    out[p, i, j, c] = np.int16(min(max(mean, -LIMIT), LIMIT))


@kernel
def consistency(flow, pairs, reverse, tolerance, trust):
    """trust[p] <- 255 exp(-|forward + backward flow|^2 / tolerance^2), uint8; reverse[p] is the opposite pair."""
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
def weigh(distance, trust, credit, tolerance, weights):
    """weights[p] <- credit[p] trust[p] exp(-z), uint8, with z = distance / tolerance^2.

    exp(z) is its Taylor series to z^3.
    """
    one, half, sixth = distance.dtype.type(1), distance.dtype.type(1 / 2), distance.dtype.type(1 / 6)
    inverse = one / (tolerance * tolerance)
    for p in numba.prange(len(trust)):
        share = distance.dtype.type(credit[p])
        for i in range(trust.shape[1]):
            for j in range(trust.shape[2]):
                z = max(distance[p, i, j], distance.dtype.type(0)) * inverse
                weights[p, i, j] = np.uint8(share * trust[p, i, j] / (one + z * (one + z * (half + z * sixth))))
