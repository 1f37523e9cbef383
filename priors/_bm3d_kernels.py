"""Groups of alike patches: finding them in a frame, filtering them together, and putting the frame together again.

A group is an array of SIDE x SIDE x SIDE, the patches of it last, so that every transform is a product of small
matrices with vectors.
"""

import numba
import numpy as np

from pnp_sci._jit import kernel, loop

SIDE = 8  # pixels of a patch, along either axis, and patches of a group: one small product serves all three axes
STEP = 4  # pixels between the patches that groups are made for; a patch is two by two cells of so many
REACH = 12  # pixels either side within which alike patches are looked for
BAND = 8  # rows of groups that are filtered one after the other


def _haar(size: int) -> np.ndarray:
    """The orthonormal Haar transform, (size, size)."""
    if size == 1:
        return np.ones((1, 1))
    coarse, fine = np.kron(_haar(size // 2), [1, 1]), np.kron(np.eye(size // 2), [1, -1])
    return np.concatenate([coarse, fine]) / np.sqrt(2)


def _cosines(size: int) -> np.ndarray:
    """The orthonormal discrete cosine transform, (size, size)."""
    k, n = np.mgrid[:size, :size]
    return np.cos(np.pi * k * (2 * n + 1) / (2 * size)) * np.sqrt(np.where(k, 2, 1) / size)


DCT, HAAR = _cosines(SIDE).astype(np.float32), _haar(SIDE).astype(np.float32)
INVERSE_DCT, INVERSE_HAAR = np.ascontiguousarray(DCT.T), np.ascontiguousarray(HAAR.T)
WINDOW = np.outer(np.kaiser(SIDE, 2), np.kaiser(SIDE, 2)).astype(np.float32)  # patches count less at their edges


@loop
def _cells(frame, top, there, shift, squares, cells):
    """cells[c] <- the squared differences of STEP x STEP pixels from those `there` and `shift` beyond; else inf."""
    low, high = max(0, -shift), min(squares.size, squares.size - shift)
    squares[:] = np.inf
    squares[low:high] = 0
    for i in range(STEP):
        a, b, s = frame[top + i, low:high], frame[there + i, low + shift : high + shift], squares[low:high]
        for j in range(s.size):
            s[j] += (a[j] - b[j]) ** 2
    for c in range(cells.size):
        at = STEP * c
        cells[c] = squares[at] + squares[at + 1] + squares[at + 2] + squares[at + 3]


@loop
def _of_four(above, below, patches):
    """The sums over patches of two by two cells."""
    for c in range(patches.size):
        patches[c] = above[c] + above[c + 1] + below[c] + below[c + 1]


@loop
def _keep(distance, place, distances, places):
    """Put a place among the SIDE nearest ones, which are sorted by distance."""
    k = SIDE - 1
    while k > 0 and distances[k - 1] > distance:
        distances[k], places[k] = distances[k - 1], places[k - 1]
        k -= 1
    distances[k], places[k] = distance, place


@kernel
def match(frames, found):
    """found[n, r, c] <- the SIDE patches most alike to that at row STEP r, column STEP c of frame n, nearest first.

    A patch is the number of its first pixel. Where there are fewer, the rest is the patch itself. Height and width are
    multiples of STEP.
    """
    count, rows, columns = frames.shape
    tops, lefts = found.shape[1:3]
    bands = (tops + BAND - 1) // BAND
    for job in numba.prange(count * bands):
        n, first = job // bands, job % bands * BAND
        frame, here = frames[n], min(BAND, tops - first)
        distances = np.full((here, lefts, SIDE), np.inf, frames.dtype)
        distances[..., 0] = -1  # the patch itself comes first
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
                            _keep(patches[c], place, distances[r, c], found[n, first + r, c])


@loop
def _gather(pixels, columns, places, group):
    """group <- the patches at these places."""
    for i in range(SIDE):
        for j in range(SIDE):
            for k in range(SIDE):
                group[i, j, k] = pixels[places[k] + i * columns + j]


@loop
def _product(matrix, v, out):
    """out (N, L) <- matrix (N, SIDE) times v (SIDE, L)."""
    for n in range(len(matrix)):
        m, o = matrix[n], out[n]
        m0, m1, m2, m3, m4, m5, m6, m7 = m[0], m[1], m[2], m[3], m[4], m[5], m[6], m[7]
        for x in range(o.size):
            first = m0 * v[0, x] + m1 * v[1, x] + m2 * v[2, x] + m3 * v[3, x]
            o[x] = first + m4 * v[4, x] + m5 * v[5, x] + m6 * v[6, x] + m7 * v[7, x]


@loop
def _transform(rows, patches, group, out):
    """out <- `rows` along both axes of the patches of a group, which is lost, `patches` from behind across them."""
    _product(rows, group.reshape(SIDE, -1), out.reshape(SIDE, -1))
    for i in range(SIDE):
        _product(rows, out[i], group[i])
    _product(group.reshape(-1, SIDE), patches, out.reshape(-1, SIDE))


@loop
def _threshold(group, least):
    """group <- 0 where smaller than `least`; returns how much its patches count, the more the less is left."""
    flat, kept = group.reshape(-1), 0
    for k in range(flat.size):
        if abs(flat[k]) < least:
            flat[k] = 0
        else:
            kept += 1
    return 1 / max(kept, 1)


@loop
def _shrink(group, pilot, variance, lanes):
    """group <- what a Wiener filter leaves of it whose signal is the pilot; returns how much its patches count."""
    flat, seen = group.reshape(-1, SIDE), pilot.reshape(-1, SIDE)
    lanes[:] = 0  # sums of every SIDE-th square: that many at a time
    for c in range(len(flat)):
        v, s = flat[c], seen[c]
        for k in range(SIDE):
            square = s[k] * s[k]
            share = square / (square + variance)
            v[k] *= share
            lanes[k] += share * share
    return 1 / max(lanes.sum(), lanes.dtype.type(1e-6))


@loop
def _scatter(group, places, columns, begin, weight, total, weights):
    """Add the patches, by weight, to total and weights, which begin at pixel `begin`."""
    for k in range(SIDE):
        for i in range(SIDE):
            at = places[k] + i * columns - begin
            for j in range(SIDE):
                w = weight * WINDOW[i, j]
                total[at + j] += w * group[i, j, k]
                weights[at + j] += w


@kernel
def collaborate(frames, pilot, sigma, least, found, out):
    """out <- frames (N, H, W), groups of patches filtered together.

    By a Wiener filter whose signal is the pilot's (N, H, W); without a pilot (0, H, W) by dropping what is below
    `least`. The mean of every group is kept.
    """
    count, rows, columns = frames.shape
    tops, lefts = found.shape[1:3]
    bands = (tops + BAND - 1) // BAND
    height = min(STEP * (BAND - 1) + SIDE + 2 * REACH, rows)
    total = np.zeros((count * bands, height * columns), frames.dtype)
    weights = np.zeros_like(total)
    for job in numba.prange(count * bands):
        n, first = job // bands, job % bands * BAND
        pixels, begin = frames[n].reshape(-1), _begin(first, height, rows) * columns
        group = np.empty((SIDE, SIDE, SIDE), frames.dtype)
        signal, spectrum, lanes = np.empty_like(group), np.empty_like(group), np.empty(SIDE, frames.dtype)
        for r in range(first, min(first + BAND, tops)):
            for c in range(lefts):
                places = found[n, r, c]
                _gather(pixels, columns, places, group)
                _transform(DCT, INVERSE_HAAR, group, spectrum)
                mean = spectrum[0, 0, 0]
                if len(pilot) > 0:
                    _gather(pilot[n].reshape(-1), columns, places, group)
                    _transform(DCT, INVERSE_HAAR, group, signal)
                    weight = _shrink(spectrum, signal, sigma * sigma, lanes)
                else:
                    weight = _threshold(spectrum, least)
                spectrum[0, 0, 0] = mean
                _transform(INVERSE_DCT, HAAR, spectrum, group)
                _scatter(group, places, columns, begin, frames.dtype.type(weight), total[job], weights[job])
    for n in numba.prange(count):
        sums, shares = np.zeros(rows * columns, frames.dtype), np.zeros(rows * columns, frames.dtype)
        for band in range(bands):
            begin = _begin(band * BAND, height, rows) * columns
            sums[begin : begin + height * columns] += total[n * bands + band]
            shares[begin : begin + height * columns] += weights[n * bands + band]
        out[n] = (sums / shares).reshape((rows, columns))


@loop
def _begin(first, height, rows):
    """The first of `height` rows that hold all patches found for a band of groups, which begins with group `first`."""
    return min(max(STEP * first - REACH, 0), rows - height)
