"""Kernels of BM3D: block matching, collaborative filtering of the groups, and aggregation.

A group is a flat array: patch after patch, row after row. Loops over it have constant length and read all operands
before they write, so that LLVM vectorises them. Where it does not, :mod:`pnp_sci.accel.simd8` has SIMD intrinsics.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel, loop, summing
from pnp_sci.accel.simd8 import add_row, copy_row, transpose
from priors.kernels.patches import keep, spread

SIDE = 8  # pixels per side of a patch, and patches per group
SQUARE, CUBE = SIDE**2, SIDE**3  # values of a patch and of a group
STEP = 4  # pixels between reference patches, and side of the cells that distances are summed over
REACH = 12  # pixels: radius of the search for similar patches
BAND = 8  # rows of groups that a job processes

# cos(k pi / 16) / 2 for k = 1 to 7, of the orthonormal discrete cosine transform
C1, C2, C3, C4, C5, C6, C7 = (np.float32(np.cos(k * np.pi / 16) / 2) for k in range(1, SIDE))
OF_TWO, OF_FOUR, OF_EIGHT = (np.float32(1 / np.sqrt(n)) for n in (2, 4, 8))  # Haar wavelets over 2, 4, 8 patches
EDGE = np.kaiser(SIDE, 2).astype(np.float32)  # Kaiser window of the aggregation
WINDOW = np.outer(EDGE, EDGE).reshape(-1)


@loop
def _cells(frame, top, there, shift, squares, cells):
    """cells[c] <- sum of squared differences of STEP x STEP pixels, `there` and `shift` displaced; inf outside."""
    low, high = max(0, -shift), min(squares.size, squares.size - shift)
    a, b, c, d = frame[top, low:], frame[top + 1, low:], frame[top + 2, low:], frame[top + 3, low:]
    at = low + shift
    p, q, r, t = frame[there, at:], frame[there + 1, at:], frame[there + 2, at:], frame[there + 3, at:]
    s = squares[low:high]
    for j in range(s.size):
        s[j] = (a[j] - p[j]) ** 2 + (b[j] - q[j]) ** 2 + (c[j] - r[j]) ** 2 + (d[j] - t[j]) ** 2
    begin, end = (low + STEP - 1) // STEP, high // STEP
    cells[:begin], cells[end:] = np.inf, np.inf
    for k in range(begin, end):
        at = STEP * k
        cells[k] = squares[at] + squares[at + 1] + squares[at + 2] + squares[at + 3]


@loop
def _of_four(above, below, patches):
    """patches[c] <- sum over the two by two cells of a patch."""
    for c in range(patches.size):
        patches[c] = above[c] + above[c + 1] + below[c] + below[c + 1]


@kernel
def match(frames, found):
    """found[n, r, c] <- the SIDE patches most similar to that at row STEP r, column STEP c of frame n, nearest first.

    A patch is given by the index of its first pixel in the flat frame. Missing patches are replaced by the reference
    patch. Height and width are multiples of STEP.
    """
    count, rows, columns = frames.shape
    tops, lefts = found.shape[1:3]
    bands = (tops + BAND - 1) // BAND
    for job in numba.prange(count * bands):
        n, first = job // bands, job % bands * BAND
        frame, here = frames[n], min(BAND, tops - first)
        distances = np.full((here, lefts, SIDE), np.inf, frames.dtype)
        for r in range(here):
            for c in range(lefts):
                found[n, first + r, c] = STEP * ((first + r) * columns + c)
        cells, squares = np.empty((here + 1, lefts + 1), frames.dtype), np.empty(columns, frames.dtype)
        patches = np.empty(lefts, frames.dtype)
        for down in range(-REACH, REACH + 1):
            for shift in range(-min(REACH, columns - SIDE), min(REACH, columns - SIDE) + 1):
                if down == 0 and shift == 0:
                    continue
                for r in range(here + 1):
                    top = STEP * (first + r)
                    if 0 <= top + down <= rows - STEP:
                        _cells(frame, top, top + down, shift, squares, cells[r])
                    else:
                        cells[r] = np.inf
                for r in range(here):
                    _of_four(cells[r], cells[r + 1], patches)
                    for c in range(lefts):
                        if patches[c] < distances[r, c, SIDE - 1]:
                            place = found[n, first + r, c, 0] + down * columns + shift
                            keep(patches[c], place, distances[r, c], found[n, first + r, c])


@loop
def _gather(pixels, columns, places, cube):
    """cube <- the patches at `places`."""
    for k in range(SIDE):
        for i in range(SIDE):
            copy_row(pixels, places[k] + i * columns, cube, SQUARE * k + SIDE * i)


@loop
def _cosines(a, b, c, d, e, f, g, h):
    """Orthonormal discrete cosine transform (DCT-II) of eight values."""
    s, t, u, v = a + h, b + g, c + f, d + e
    w, x, y, z = a - h, b - g, c - f, d - e
    outer, inner = s - v, t - u
    return (
        C4 * (s + v + t + u), C1 * w + C3 * x + C5 * y + C7 * z,
        C2 * outer + C6 * inner, C3 * w - C7 * x - C1 * y - C5 * z,
        C4 * (s + v - t - u), C5 * w - C1 * x + C7 * y + C3 * z,
        C6 * outer - C2 * inner, C7 * w - C5 * x + C3 * y - C1 * z,
    )  # fmt: skip


@loop
def _uncosines(a, b, c, d, e, f, g, h):
    """Inverse of :func:`_cosines`."""
    p, q, outer, inner = C4 * (a + e), C4 * (a - e), C2 * c + C6 * g, C6 * c - C2 * g
    s, t, u, v = p + outer, q + inner, q - inner, p - outer
    w, x = C1 * b + C3 * d + C5 * f + C7 * h, C3 * b - C7 * d - C1 * f - C5 * h
    y, z = C5 * b - C1 * d + C7 * f + C3 * h, C7 * b - C5 * d + C3 * f - C1 * h
    return s + w, t + x, u + y, v + z, v - z, u - y, t - x, s - w


@loop
def _columns(transform, v):
    """Apply `transform` to the columns of each patch of v, in place."""
    for k in range(SIDE):
        for j in range(SIDE):
            at = SQUARE * k + j
            a, b, c, d, e, f, g, h = transform(
                v[at], v[at + SIDE], v[at + 2 * SIDE], v[at + 3 * SIDE],
                v[at + 4 * SIDE], v[at + 5 * SIDE], v[at + 6 * SIDE], v[at + 7 * SIDE],
            )  # fmt: skip
            v[at], v[at + SIDE], v[at + 2 * SIDE], v[at + 3 * SIDE] = a, b, c, d
            v[at + 4 * SIDE], v[at + 5 * SIDE], v[at + 6 * SIDE], v[at + 7 * SIDE] = e, f, g, h


@loop
def _transposed(v):
    """Transpose each patch of v, in place."""
    for k in range(SIDE):
        transpose(v, SQUARE * k)


@loop
def _haar(v):
    """Orthonormal Haar transform across the patches of v, in place; the mean comes first."""
    for x in range(SQUARE):
        a, b, c, d = v[x], v[x + SQUARE], v[x + 2 * SQUARE], v[x + 3 * SQUARE]
        e, f, g, h = v[x + 4 * SQUARE], v[x + 5 * SQUARE], v[x + 6 * SQUARE], v[x + 7 * SQUARE]
        ab, cd, ef, gh = a + b, c + d, e + f, g + h
        v[x], v[x + SQUARE] = OF_EIGHT * (ab + cd + ef + gh), OF_EIGHT * (ab + cd - ef - gh)
        v[x + 2 * SQUARE], v[x + 3 * SQUARE] = OF_FOUR * (ab - cd), OF_FOUR * (ef - gh)
        v[x + 4 * SQUARE], v[x + 5 * SQUARE] = OF_TWO * (a - b), OF_TWO * (c - d)
        v[x + 6 * SQUARE], v[x + 7 * SQUARE] = OF_TWO * (e - f), OF_TWO * (g - h)


@loop
def _unhaar(v):
    """Inverse of :func:`_haar`."""
    for x in range(SQUARE):
        s, t = OF_EIGHT * v[x], OF_EIGHT * v[x + SQUARE]
        p, q = OF_FOUR * v[x + 2 * SQUARE], OF_FOUR * v[x + 3 * SQUARE]
        a, b = OF_TWO * v[x + 4 * SQUARE], OF_TWO * v[x + 5 * SQUARE]
        c, d = OF_TWO * v[x + 6 * SQUARE], OF_TWO * v[x + 7 * SQUARE]
        v[x], v[x + SQUARE] = s + t + p + a, s + t + p - a
        v[x + 2 * SQUARE], v[x + 3 * SQUARE] = s + t - p + b, s + t - p - b
        v[x + 4 * SQUARE], v[x + 5 * SQUARE] = s - t + q + c, s - t + q - c
        v[x + 6 * SQUARE], v[x + 7 * SQUARE] = s - t - q + d, s - t - q - d


@loop
def _spectrum(pixels, columns, places, cube):
    """cube <- the 3-D transform of the group of patches at `places`, each patch transposed."""
    _gather(pixels, columns, places, cube)
    _haar(cube)
    _columns(_cosines, cube)
    _transposed(cube)
    _columns(_cosines, cube)


@loop
def _unspectrum(cube):
    """Inverse of :func:`_spectrum`, in place: the group of patches of a 3-D transform."""
    _columns(_uncosines, cube)
    _transposed(cube)
    _columns(_uncosines, cube)
    _unhaar(cube)


@loop
def _threshold(cube, least):
    """Hard thresholding of cube at `least`; returns the aggregation weight, 1 / number of coefficients kept."""
    kept = 0
    for x in range(cube.size):
        if abs(cube[x]) < least:
            cube[x] = 0
        else:
            kept += 1
    return 1 / max(kept, 1)


@summing
def _shrink(cube, signal, variance):
    """Wiener filter of cube for a signal's spectrum and noise `variance`; returns the aggregation weight."""
    squares = cube.dtype.type(0)
    for x in range(CUBE):
        square = signal[x] * signal[x]
        left = square / (square + variance)
        cube[x] *= left
        squares += left * left
    return 1 / max(squares, 1e-6)


@loop
def _scatter(cube, window, weight, places, columns, begin, total, weights):
    """Add the patches of a cube times weight and window to `total`, and the weight to `weights` at their places.

    total and weights begin at pixel `begin`. The cube is overwritten. `spread` applies the window to weights.
    """
    for k in range(SIDE):
        for x in range(SQUARE):
            cube[SQUARE * k + x] *= weight * window[x]
        for i in range(SIDE):
            add_row(cube, SQUARE * k + SIDE * i, total, places[k] + i * columns - begin)
        weights[places[k] - begin] += weight


@kernel
def collaborate(frames, pilot, level, threshold, found, out):
    """Collaborative filtering: out <- frames (N, H, W) with their groups of patches filtered jointly.

    With a pilot (N, H, W), the filter is a Wiener filter with the pilot's spectrum. Without one (0, H, W), coefficients
    below `threshold`, in units of the noise, are set to 0. Each group has a noise level > 0, level (N, R, C); its
    weight falls with the square of the level. The mean of each group is kept.
    """
    count, rows, columns = frames.shape
    tops, lefts = found.shape[1:3]
    bands = (tops + BAND - 1) // BAND
    height = min(STEP * (BAND - 1) + SIDE + 2 * REACH, rows)
    total = np.zeros((count * bands, height * columns), frames.dtype)
    weights = np.zeros_like(total)
    for job in numba.prange(count * bands):
        n, first = job // bands, job % bands * BAND
        pixels, begin, faintest = frames[n].reshape(-1), _begin(first, height, rows) * columns, level[n].min()
        cube, signal = np.empty(CUBE, frames.dtype), np.empty(CUBE, frames.dtype)
        for r in range(first, min(first + BAND, tops)):
            for c in range(lefts):
                places, sigma = found[n, r, c], level[n, r, c]
                _spectrum(pixels, columns, places, cube)
                mean = cube[0]
                if len(pilot) > 0:
                    _spectrum(pilot[n].reshape(-1), columns, places, signal)
                    weight = _shrink(cube, signal, sigma * sigma)
                else:
                    weight = _threshold(cube, threshold * sigma)
                weight *= (faintest / sigma) ** 2
                cube[0] = mean
                _unspectrum(cube)
                _scatter(cube, WINDOW, frames.dtype.type(weight), places, columns, begin, total[job], weights[job])
    for n in numba.prange(count):
        sums, counts = np.zeros((rows, columns), frames.dtype), np.zeros((rows, columns), frames.dtype)
        for band in range(bands):
            begin, job = _begin(band * BAND, height, rows), n * bands + band
            sums[begin : begin + height] += total[job].reshape(height, columns)
            counts[begin : begin + height] += weights[job].reshape(height, columns)
        shares = np.empty((rows, columns), frames.dtype)
        spread(counts, EDGE, shares)
        out[n] = sums / shares


@loop
def _begin(first, height, rows):
    """First of the `height` rows that contain all patches of a band of groups that begins with group `first`."""
    return min(max(STEP * first - REACH, 0), rows - height)
