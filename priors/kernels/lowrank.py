"""Kernels of low rank: the weighted nuclear norm of groups of similar patches, and their aggregation.

A group is a matrix: a patch a row, without the mean of its patches. A patch is given by the index of its first pixel in
the flat view. Patches of 8 x 8 pixels have SIMD intrinsics, those of other sizes plain loops.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel, loop
from pnp_sci.accel.simd8 import add_row, copy_row
from priors.kernels.matrices import SMALL, add_times, eigen, gram_of, inverse, times
from priors.kernels.patches import spread

FAST = 8  # pixels per side of a patch for which there are SIMD intrinsics


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
        add_times(mean.dtype.type(1), group[k], mean)
    mean /= mean.dtype.type(len(group))
    for k in range(len(group)):
        add_times(mean.dtype.type(-1), mean, group[k])


@loop
def _reweighted(gram, weight, half, factors):
    """factors <- G (G + C)^-1 for the weight C: one step of reweighting, with the singular values of an estimate.

    Where C is too small for float32, they are ``1 - C (G + ridge)^-1``, which shrinks less, not more. The estimate's
    Gram matrix is overwritten.
    """
    count, trace = len(gram), gram.dtype.type(0)
    for k in range(count):
        trace += gram[k, k]
    ridge = max(weight, gram.dtype.type(SMALL) * trace, gram.dtype.type(1e-30))
    gram *= 1 / ridge
    for k in range(count):
        gram[k, k] += 1
    inverse(gram, half, factors)
    for k in range(count):
        for m in range(count):
            factors[k, m] *= -weight / ridge
        factors[k, k] += 1


@loop
def _shrunk(gram, weight, vectors, factors):
    """factors <- those of the closed form: singular values s become ``(s + sqrt(s^2 - 4 C)) / 2``, or 0 if s^2 < 4 C.

    The Gram matrix is that of the group; it is overwritten.
    """
    eigen(gram, vectors)
    factors[:] = 0
    for k in range(len(gram)):
        if gram[k, k] > 4 * weight:
            kept = (1 + np.sqrt(1 - 4 * weight / gram[k, k])) / 2
            for m in range(len(gram)):
                add_times(gram.dtype.type(kept) * vectors[k, m], vectors[k], factors[m])


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
                add_times(flat.dtype.type(1), flat[at : at + side], total[to : to + side])
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
                gram_of(low, gram)
                if rounds > 0:
                    _reweighted(gram, weight, scratch, factors)
                else:
                    _shrunk(gram, weight, scratch, factors)
                times(factors, wide, low)
            _turn(low, tall, group)
            places -= start
            _scatter(group, mean, window, side, places, columns, total, weights)


@loop
def _add(n, begins, total, weights, out, counts):
    """out, counts (H, W) of frame n += the sums of some frames, of which each begins with another frame."""
    for b in range(begins.size):
        at = (n - begins[b]) * out.size
        if 0 <= at < total.shape[1]:
            out += total[b, at : at + out.size].reshape(out.shape)
            counts += weights[b, at : at + out.size].reshape(out.shape)


@kernel
def collaborate(view, pilot, weight, rounds, side, edge, found, reach, threads, out):
    """out <- a view (B, H, W) with its groups of patches (B, R, C, K) brought to low rank.

    `weight` is the C of :func:`_reweighted` and :func:`_shrunk`. With `rounds` of 0 groups are shrunk in closed form.
    Else the singular values are those of the pilot (B, H, W), or without one (0, H, W) those of the group itself, and
    then those of the round before. A group has patches of frames up to `reach` away. `edge` is the window of a patch.
    Each of `threads` frames at a time has sums of its own, which are added in the order of the frames.
    """
    frames = len(view)
    deep = min(2 * reach + 1, frames)
    begins = np.empty(frames, np.int64)
    for b in range(frames):
        begins[b] = min(max(b - reach, 0), frames - deep)
    total = np.empty((min(threads, frames), deep * view[0].size), view.dtype)
    weights, counts = np.empty_like(total), np.zeros_like(view)
    out[:] = 0
    for first in range(0, frames, threads):
        now = begins[first : first + threads]
        total[:], weights[:] = 0, 0
        for k in numba.prange(now.size):
            b = first + k
            _of_frame(view, pilot, weight, rounds, side, edge, found[b], now[k], total[k], weights[k])
        for n in numba.prange(frames):
            _add(n, now, total, weights, out[n], counts[n])
    for n in numba.prange(frames):
        shares = np.empty_like(counts[n])
        spread(counts[n], edge, shares)
        out[n] /= shares
