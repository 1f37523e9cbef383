"""The truth, and how close a video comes to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import real_array, white
from pnp_sci.errors import InputError
from pnp_sci.metrics import psnr, ssim


class Reference:
    """The truth of all measurements, with the seconds that comparing with it has taken.

    Parameters
    ----------
    reference : array_like
        The truth, floats in [0, 1], uint8 or uint16.
    shape : tuple
        (N, V, B, H, W), as expected; N may be left out if it is 1.
    """

    def __init__(self, reference: Any, shape: tuple[int, ...]):
        array = real_array("reference", reference)
        if _longer_than_one(array.shape) != _longer_than_one(shape):
            raise InputError(f"reference has shape {array.shape}: {shape[1:] if shape[0] == 1 else shape} was expected")
        self.white = white("reference", array.dtype)
        self.array = array.reshape(shape)
        self.seconds = 0.0

    def psnr(self, x: np.ndarray, n: int, unit: float = 1.0) -> float:
        """Mean over the views of measurement n, for x in so many of the reference's units."""
        return self._mean(psnr, x, n, unit)

    def ssim(self, x: np.ndarray, n: int) -> float:
        """Mean over the views, of measurement n."""
        return self._mean(ssim, x, n)

    def _mean(self, metric: Callable[..., Any], x: np.ndarray, n: int, unit: float = 1.0) -> float:
        begin = time.perf_counter()
        with np.errstate(over="ignore"):  # metrics clip to [0, 1]
            mean = float(np.mean(metric(x * (unit / self.white), self.array[n] / self.white)))
        self.seconds += time.perf_counter() - begin
        return mean


def _longer_than_one(shape: tuple[int, ...]) -> list[int]:
    return [length for length in shape if length > 1]
