"""Pixels that show the same in all frames: what one frame holds of them, all others hold too."""

import numba
import numpy as np

from pnp_sci.accel.jit import kernel

# In front of a ground darker than the former, a dark thing that moves changes x little: in proportion to how bright the
# ground is, but for the latter part of it. In a real capture a dark frame round a lens, moving before a dark hand,
# vanished without this; the 18 clips of benchmarks/still_regions.py gain 0.19 dB in the place of 0.22 with `flow` and
# 0.16 of 0.18 with TV. With `flow` and half the limits, bright or dark, they gain 0.10.
BRIGHT, DARKEST = 0.5, 0.05
HARDLY = 0.02  # a row in which nothing is stiller than that is left as it is: most of those that move cost nothing


def sureness(change, brightness, rest):
    """How surely pixels (H, W) show the same in all frames, 0 to 1, by their squared change and mean along time.

    ``exp(-change / r^2)``, r being `rest` where the mean is 1/2 or more, and in proportion to it below, down to a
    twentieth.
    """
    r = rest * np.clip(brightness / BRIGHT, DARKEST, 1)
    with np.errstate(under="ignore"):  # what surely moves
        return np.exp(-change / r**2)


@kernel
def mean_and_variance(view, brightness, variance):
    """brightness, variance (H, W) <- those of a view (B, H, W) along time."""
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
        brightness[i] = mean


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
