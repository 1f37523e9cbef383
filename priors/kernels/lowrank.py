"""Kernels of low rank: groups of similar patches along the motion, their weighted nuclear norm, and aggregation.

A group is a matrix: a patch a row, without the mean of its patches. A patch is given by the index of its first pixel in
the flat view. Patches of 8 x 8 pixels have SIMD intrinsics, those of other sizes plain loops.
"""

from functools import partial

import numba
import numpy as np

from pnp_sci.accel.jit import FASTMATH, compiled, kernel, loop
from pnp_sci.accel.simd8 import add_row, copy_row, multiply_16
from priors.kernels.average import FRACTION

FAST = 8  # pixels per side of a patch for which there are SIMD intrinsics
SWEEPS = 30  # most sweeps of Jacobi's rotations; they converge quadratically, in some ten
SMALL = 1e-6  # least ridge in units of the largest eigenvalue: float32 cannot factorise less

# a loop whose sums LLVM may reorder
summing = partial(compiled, fastmath=FASTMATH | {"reassoc"})


@summing
def _distance(pixels, p, q, columns, side):
    """Sum of squared differences of the patches at p and q."""
    total = pixels.dtype.type(0)
    for i in range(side):
        for j in range(side):
            d = pixels[p + i * columns + j] - pixels[q + i * columns + j]
            total += d * d
    return total


@loop
def _keep(distance, place, distances, places):
    """Insert a place into the nearest ones, sorted by distance; the first stays."""
    k = places.size - 1
    while k > 1 and distances[k - 1] > distance:
        distances[k], places[k] = distances[k - 1], places[k - 1]
        k -= 1
    distances[k], places[k] = distance, place


@loop
def _search(view, side, frame, row, column, reach, places, distances):
    """Insert the patches of a frame whose first pixels are up to `reach` from (row, column)."""
    rows, columns = view.shape[1:]
    pixels, last = view.reshape(-1), places.size - 1
    row, column = min(max(row, 0), rows - side), min(max(column, 0), columns - side)
    for y in range(max(row - reach, 0), min(row + reach, rows - side) + 1):
        for x in range(max(column - reach, 0), min(column + reach, columns - side) + 1):
            place = (frame * rows + y) * columns + x
            if place == places[0]:
                continue
            if side == FAST:  # a constant, for which LLVM unrolls
                distance = _distance(pixels, places[0], place, columns, FAST)
            else:
                distance = _distance(pixels, places[0], place, columns, side)
            if distance < distances[last]:
                _keep(distance, place, distances, places)


@kernel
def match(view, side, tops, lefts, flow, pairs, first, reach, near, found):
    """found[b, i, j] <- the patches of a view (B, H, W) most similar to that of frame b at tops[i], lefts[j].

    Candidates are all patches of the frame up to `reach` pixels away, and those of its neighbours up to `near` pixels
    from where the flow leads. pairs[first[b]:first[b + 1]] are the pairs (b, n) of frame b; flow: (P, ceil(H / 2),
    ceil(W / 2), 2), (columns, rows) in 1/FRACTION pixel. The patch itself comes first and stands for missing ones.
    """
    rows, columns = view.shape[1:]
    for job in numba.prange(len(view) * tops.size):
        b, i = job // tops.size, job % tops.size
        distances = np.empty(found.shape[3], view.dtype)
        for j in range(lefts.size):
            places, row, column = found[b, i, j], tops[i], lefts[j]
            places[:], distances[:] = (b * rows + row) * columns + column, np.inf
            _search(view, side, b, row, column, reach, places, distances)
            y, x = min(row + side // 2, rows - 1) // 2, min(column + side // 2, columns - 1) // 2
            for p in range(first[b], first[b + 1]):
                down, across = np.rint(flow[p, y, x, 1] / FRACTION), np.rint(flow[p, y, x, 0] / FRACTION)
                there = row + np.int64(down), column + np.int64(across)
                _search(view, side, pairs[p, 1], there[0], there[1], near, places, distances)


@loop
def _gather(pixels, columns, side, places, group):
    """group <- the patches at `places`."""
    flat = group.reshape(-1)
    for k in range(places.size):
        for i in range(side):
            at, to = places[k] + i * columns, (side * k + i) * side
            if side == FAST:
                copy_row(pixels, at, flat, to)
            else:
                flat[to : to + side] = pixels[at : at + side]


@loop
def _centre(group, mean):
    """mean <- the mean of the rows of a group, which are left without it."""
    mean[:] = 0
    for k in range(len(group)):
        _add_times(mean.dtype.type(1), group[k], mean)
    mean /= mean.dtype.type(len(group))
    for k in range(len(group)):
        _add_times(mean.dtype.type(-1), mean, group[k])


@loop
def _add_times(factor, v, out):
    """out += factor * v."""
    for x in range(out.size):
        out[x] += factor * v[x]


@summing
def _dot(a, b):
    """Inner product."""
    total = a.dtype.type(0)
    for x in range(a.size):
        total += a[x] * b[x]
    return total


@loop
def _gram(rows, gram):
    """gram <- rows @ rows.T."""
    for k in range(len(rows)):
        for m in range(k + 1):
            gram[k, m] = gram[m, k] = _dot(rows[k], rows[m])


@loop
def _times(factors, rows, out):
    """out <- factors @ rows."""
    count, width = rows.shape
    if count % 4 == 0 and width % 16 == 0:
        f, v, o = factors.reshape(-1), rows.reshape(-1), out.reshape(-1)
        for k in range(0, count, 4):
            for x in range(0, width, 16):
                multiply_16(f, k * count, count, v, x, width, o, k * width + x)
    else:
        out[:] = 0
        for k in range(count):
            for m in range(count):
                _add_times(factors[k, m], rows[m], out[k])


@loop
def _factorise(a):
    """Lower part of a <- that of its Cholesky factor, with the reciprocals of the diagonal."""
    for k in range(len(a)):
        for m in range(k):
            a[k, m] = (a[k, m] - _dot(a[k, :m], a[m, :m])) * a[m, m]
        a[k, k] = 1 / np.sqrt(max(a[k, k] - _dot(a[k, :k], a[k, :k]), a.dtype.type(SMALL)))


@loop
def _inverse(a, half, out):
    """out <- the inverse of a, which is overwritten; half <- the inverse of its Cholesky factor, transposed."""
    count = len(a)
    _factorise(a)
    for m in range(count):
        half[m, m] = a[m, m]
        for k in range(m + 1, count):
            half[m, k] = -_dot(a[k, m:k], half[m, m:k]) * a[k, k]
    for k in range(count):
        for m in range(k + 1):
            out[k, m] = out[m, k] = _dot(half[k, k:], half[m, k:])


@loop
def _reweighted(gram, weight, half, factors):
    """factors <- G (G + C)^-1 for the weight C: one step of reweighting, with the singular values of an estimate.

    The estimate's Gram matrix is overwritten.
    """
    count, largest = len(gram), gram.dtype.type(0)
    for k in range(count):
        largest = max(largest, gram[k, k])
    scale = 1 / max(weight, gram.dtype.type(SMALL) * largest, gram.dtype.type(1e-30))
    gram *= scale
    for k in range(count):
        gram[k, k] += 1
    _inverse(gram, half, factors)
    for k in range(count):
        for m in range(count):
            factors[k, m] = -factors[k, m]
        factors[k, k] += 1


@loop
def _eigen(a, vectors):
    """Jacobi's rotations: the diagonal of a <- its eigenvalues, vectors <- eigenvectors, one a row."""
    count, one = len(a), a.dtype.type(1)
    vectors[:] = 0
    for k in range(count):
        vectors[k, k] = 1
    for _ in range(SWEEPS):
        turned = False
        for p in range(count - 1):
            for q in range(p + 1, count):
                if abs(a[p, q]) <= 1e-7 * np.sqrt(abs(a[p, p] * a[q, q])):
                    continue
                turned = True
                slope = (a[q, q] - a[p, p]) / (2 * a[p, q])
                t = one / (abs(slope) + np.sqrt(slope * slope + one)) * np.sign(slope) if slope != 0 else one
                c = one / np.sqrt(t * t + one)
                s = t * c
                for k in range(count):
                    x, y = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * x - s * y, s * x + c * y
                for m in (a, vectors):
                    for k in range(count):
                        x, y = m[p, k], m[q, k]
                        m[p, k], m[q, k] = c * x - s * y, s * x + c * y
        if not turned:
            break


@loop
def _shrunk(gram, weight, vectors, factors):
    """factors <- those of the closed form: singular values s become ``(s + sqrt(s^2 - 4 C)) / 2``, or 0 if s^2 < 4 C.

    The Gram matrix is that of the group; it is overwritten.
    """
    _eigen(gram, vectors)
    factors[:] = 0
    for k in range(len(gram)):
        if gram[k, k] > 4 * weight:
            kept = (1 + np.sqrt(1 - 4 * weight / gram[k, k])) / 2
            for m in range(len(gram)):
                _add_times(gram.dtype.type(kept) * vectors[k, m], vectors[k], factors[m])


@loop
def _scatter(group, mean, window, side, places, columns, total, weights):
    """Add the patches of a group times the window to `total`, and 1 to `weights` at their places."""
    flat = group.reshape(-1)
    for k in range(places.size):
        for x in range(mean.size):
            group[k, x] = (group[k, x] + mean[x]) * window[x]
        for i in range(side):
            at, to = (side * k + i) * side, places[k] + i * columns
            if side == FAST:
                add_row(flat, at, total, to)
            else:
                _add_times(flat.dtype.type(1), flat[at : at + side], total[to : to + side])
        weights[places[k]] += 1


@loop
def _turn(matrix, transposed, out):
    """out <- the matrix, or its transpose."""
    if transposed:
        out[:] = matrix.T
    else:
        out[:] = matrix


@loop
def _of_frame(view, pilot, weight, rounds, side, edge, found, begin, total, weights):
    """Groups (R, C, K) that begin in a frame: the sum of their patches, and their weights, from frame `begin` on."""
    columns, count, area = view.shape[2], found.shape[2], side * side
    order, tall = min(count, area), count > area
    window, start = np.outer(edge, edge).reshape(-1), begin * view[0].size
    group, mean, places = np.empty((count, area), view.dtype), np.empty(area, view.dtype), np.empty(count, np.int64)
    wide = np.empty((order, max(count, area)), view.dtype)  # a group, transposed if it has more rows than columns
    low, gram = np.empty_like(wide), np.empty((order, order), view.dtype)
    scratch, factors = np.zeros_like(gram), np.empty_like(gram)
    for i in range(found.shape[0]):
        for j in range(found.shape[1]):
            places[:] = found[i, j]
            if len(pilot) > 0:
                _gather(pilot.reshape(-1), columns, side, places, group)
                _centre(group, mean)
                _turn(group, tall, low)
            _gather(view.reshape(-1), columns, side, places, group)
            _centre(group, mean)
            _turn(group, tall, wide)
            if len(pilot) == 0:
                low[:] = wide
            for _ in range(max(rounds, 1)):
                _gram(low, gram)
                if rounds > 0:
                    _reweighted(gram, weight, scratch, factors)
                else:
                    _shrunk(gram, weight, scratch, factors)
                _times(factors, wide, low)
            _turn(low, tall, group)
            places -= start
            _scatter(group, mean, window, side, places, columns, total, weights)


@loop
def _spread(weights, edge):
    """Sum of the windows of all patches, times the weight (H, W) at the first pixel of each patch."""
    rows, columns = weights.shape
    along, out = np.zeros_like(weights), np.zeros_like(weights)
    for d in range(edge.size):
        along[:, d:] += edge[d] * weights[:, : columns - d]
    for d in range(edge.size):
        out[d:] += edge[d] * along[: rows - d]
    return out


@loop
def _merged(n, begins, total, weights, edge, out):
    """out (H, W) <- frame n, from the sums of all frames, of which each begins with another frame."""
    size = out.size
    sums, counts = np.zeros_like(out), np.zeros_like(out)
    for b in range(begins.size):
        at = (n - begins[b]) * size
        if 0 <= at < total.shape[1]:
            sums += total[b, at : at + size].reshape(out.shape)
            counts += weights[b, at : at + size].reshape(out.shape)
    out[:] = sums / _spread(counts, edge)


@kernel
def collaborate(view, pilot, weight, rounds, side, edge, found, reach, out):
    """out <- a view (B, H, W) with its groups of patches (B, R, C, K) brought to low rank.

    `weight` is the C of :func:`_reweighted` and :func:`_shrunk`. With `rounds` of 0 groups are shrunk in closed form.
    Else the singular values are those of the pilot (B, H, W), or without one (0, H, W) those of the group itself, and
    then those of the round before. A group has patches of frames up to `reach` away. `edge` is the window of a patch.
    """
    frames = len(view)
    deep = min(2 * reach + 1, frames)
    begins = np.empty(frames, np.int64)
    for b in range(frames):
        begins[b] = min(max(b - reach, 0), frames - deep)
    total = np.zeros((frames, deep * view[0].size), view.dtype)
    weights = np.zeros_like(total)
    for b in numba.prange(frames):
        _of_frame(view, pilot, weight, rounds, side, edge, found[b], begins[b], total[b], weights[b])
    for n in numba.prange(frames):
        _merged(n, begins, total, weights, edge, out[n])
