"""The truth, and how close a video comes to it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import real_array, require_finite, white
from pnp_sci.errors import InputError
from pnp_sci.metrics import psnr, ssim

OTHER_UNITS = 1.5  # the fitted gain from which a reference is in other units: estimates of dim scenes have 0.8


class Reference:
    """The truth of all measurements, with the seconds that comparing with it has taken.

    Parameters
    ----------
    reference : array_like
        The truth, >= 0.
    shape : tuple
        (N, V, B, H, W), as expected, of mosaics (N, V, B, H, W, 3); N may be left out if it is 1.
    peak : float, optional
        The value of white, in the reference's units, which should be those of the result. By default that of the
        reference's type; of uint16 and of floats from 2 on, that of 8, 10, 12, 14 or 16 bits, as few as hold them.
    shown : callable, optional
        What makes of a solver's video (V, B, H, W) one that is compared: mosaics are compared in colour.
    """

    def __init__(
        self,
        reference: Any,
        shape: tuple[int, ...],
        peak: float | None = None,
        shown: Callable[[np.ndarray], np.ndarray] = np.asarray,
    ):
        array = real_array("reference", reference)
        if _longer_than_one(array.shape) != _longer_than_one(shape):
            raise InputError(f"reference has shape {array.shape}: {shape[1:] if shape[0] == 1 else shape} was expected")
        require_finite("reference", array)
        largest = float(array.max(initial=0))
        self.white = peak or white("reference", array.dtype, largest)
        self.guessed = ""
        sure = array.dtype == np.uint8 or self.white == 1 or (array.dtype.kind == "u" and self.white == 65535)
        if peak is None and not sure:
            told = f"the reference has values up to {largest:g} in {array.dtype}: white is taken to be {self.white:g}"
            self.guessed = f"{told}; peak= says otherwise"
        if array.min(initial=0) < -1e-6 * self.white or largest > (1 + 1e-6) * self.white:
            expected = f"values from 0 to {self.white:g}, which is white, were expected; peak= says what is white"
            raise InputError(f"reference spans {array.min():g} to {largest:g}: {expected}")
        self.array = array.reshape(shape)
        self.shown, self.seconds = shown, 0.0

    def psnr(self, x: np.ndarray, n: int, unit: float | np.ndarray = 1.0) -> float:
        """Mean over the views of measurement n, for x in so many of the reference's units."""
        return self._mean(psnr, x, n, unit)

    def remarks(self, x: np.ndarray, n: int) -> list[str]:
        """What is to be said of white, and of measurement n where x and the reference are in different units."""
        begin = time.perf_counter()
        truth, video = (a.astype(np.float64) / self.white for a in (self.array[n], self.shown(x)))
        gain = float((video * truth).sum() / max((truth**2).sum(), np.finfo(float).tiny))
        told = [] if 1 / OTHER_UNITS < gain < OTHER_UNITS or not truth.any() else [self._other_units(video, n, gain)]
        self.seconds += time.perf_counter() - begin
        return [self.guessed, *told] if self.guessed else told

    def _other_units(self, x: np.ndarray, n: int, gain: float) -> str:
        text = f"the result is {gain:.3g} times the reference, so that PSNR and SSIM say nothing of its quality"
        if gain > 0:
            fitted = float(np.mean(psnr(x / gain, self.array[n] / self.white)))
            text += f": with this gain divided out, PSNR is {fitted:.2f} dB"
        return text + "; give a reference in the units of y over those of the masks"

    def ssim(self, x: np.ndarray, n: int) -> float:
        """Mean over the views, of measurement n."""
        return self._mean(ssim, x, n)

    def _mean(self, metric: Callable[..., Any], x: np.ndarray, n: int, unit: float | np.ndarray = 1.0) -> float:
        begin = time.perf_counter()
        with np.errstate(over="ignore"):  # clipped as metrics do; other units are among the remarks
            video = np.clip(self.shown(x * (unit / self.white)), 0, 1)
        mean = float(np.mean(metric(video, self.array[n] / self.white)))
        self.seconds += time.perf_counter() - begin
        return mean


def _longer_than_one(shape: tuple[int, ...]) -> list[int]:
    return [length for length in shape if length > 1]
