"""Still pixels: detection by their variance along time, and averaging over all frames."""

from dataclasses import dataclass

import numba
import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import library
from pnp_sci.accel.jit import kernel

DARKEST = 1e-6  # lower bound of the factor on the limit, so that it stays above 0
HARDLY = 0.02  # largest probability of a row that is skipped, to save time


@dataclass(frozen=True)
class StillNumbers(Tuned):
    """The limit of a still pixel's change, and its course in the dark, where moving objects change x little."""

    rest: float = 0.04  # largest standard deviation along time at which a pixel counts 1/e as still
    bright: float = 0.5  # mean along time below which the limit is proportional to the mean


TUNED = StillNumbers()


def sureness(change, brightness, rest):
    """Probability that pixels are constant in time, 0 to 1: ``exp(-change / r^2)``, of arrays or of tensors.

    change: squared change along time; brightness: mean along time. The limit r is `rest` (> 0) for bright pixels. For
    dark ones it is proportional to their mean, with a lower bound.
    """
    with np.errstate(under="ignore", over="ignore"):  # pixels that move, and a limit that all pixels keep
        r = rest * (brightness / TUNED.bright).clip(DARKEST, 1)
        return library(change).exp(-change / r**2)


@kernel
def mean_and_variance(view, brightness, variance):
    """brightness, variance (H, W) <- mean and variance along time of a view (B, H, W)."""
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
    """out (B, H, W) <- out + still * (mean over frames of view - out); `out` may be `view`."""
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
