"""What kernels of patches share: the nearest places of a search, and windows of overlapping patches."""

import numpy as np

from pnp_sci.accel.jit import loop
from priors.kernels.matrices import add_times


@loop
def keep(distance, place, distances, places):
    """Insert a place into the nearest ones, sorted by distance; the first stays."""
    k = places.size - 1
    while k > 1 and distances[k - 1] > distance:
        distances[k], places[k] = distances[k - 1], places[k - 1]
        k -= 1
    distances[k], places[k] = distance, place


@loop
def spread(weights, edge, out):
    """out (H, W) <- sum of the windows of all patches, times the weight (H, W) at the first pixel of each patch.

    The window is the outer product of `edge` with itself.
    """
    rows, columns = weights.shape
    side = edge.size
    out[:] = 0
    along = np.zeros(columns, weights.dtype)
    for r in range(rows - side + 1):
        along[:] = 0
        for j in range(side):
            add_times(edge[j], weights[r, : columns - side + 1], along[j : columns - side + 1 + j])
        for i in range(side):
            add_times(edge[i], along, out[r + i])
