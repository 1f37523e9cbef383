"""Search for similar patches within a frame and along the motion.

A patch is given by the index of its first pixel in the flat view.
"""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel, loop, summing
from priors.kernels.average import FRACTION
from priors.kernels.patches import keep

FAST = 8  # pixels per side of a patch for which LLVM unrolls


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
                keep(distance, place, distances, places)


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
            y, x = (row + side // 2) // 2, (column + side // 2) // 2
            for p in range(first[b], first[b + 1]):
                down, across = np.rint(flow[p, y, x, 1] / FRACTION), np.rint(flow[p, y, x, 0] / FRACTION)
                there = row + np.int64(down), column + np.int64(across)
                _search(view, side, pairs[p, 1], there[0], there[1], near, places, distances)
