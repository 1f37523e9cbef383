"""Pixels that show the same in all frames: what one frame holds of them, all others hold too."""

import numba
import numpy as np

from pnp_sci._jit import kernel

HARDLY = 0.02  # a row in which nothing is stiller than that is left as it is: most of those that move cost nothing


@kernel
def spread(view, variance):
    """variance (H, W) <- that of a view (B, H, W) along time."""
    frames, rows, columns = view.shape
    part = view.dtype.type(1 / frames)
    for i in numba.prange(rows):
        mean = np.zeros(columns, view.dtype)
        for b in range(frames):
            for j in range(columns):
                mean[j] += part * view[b, i, j]
        o = variance[i]
        o[:] = 0
        for b in range(frames):
            for j in range(columns):
                o[j] += part * (view[b, i, j] - mean[j]) ** 2


@kernel
def tie(view, still, out):
    """out (B, H, W) <- out + still * (mean of the frames of view - out); out may be the view itself."""
    frames, rows, columns = view.shape
    part = view.dtype.type(1 / frames)
    for i in numba.prange(rows):
        if still[i].max() < HARDLY:
            continue
        mean = np.zeros(columns, view.dtype)
        for b in range(frames):
            for j in range(columns):
                mean[j] += part * view[b, i, j]
        for b in range(frames):
            o = out[b, i]
            for j in range(columns):
                o[j] += still[i, j] * (mean[j] - o[j])
