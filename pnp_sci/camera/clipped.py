"""Pictures of a calibration that the camera has clipped at its largest value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

PART, FEW = 1e-3, 16  # smallest part and number of values that are a pile
LOUD = 90  # percentile of the noise of pixels: closed elements may have none, as where a camera clips at 0
ENOUGH = 10_000  # pixels that tell the noise of all
COARSE = 0.6  # grey levels: of noise below that, most values may be the largest one though nothing is clipped


@dataclass(frozen=True)
class Clipped:
    """Pictures of which many values are exactly the largest one; ``str()`` of it says what to do.

    Attributes
    ----------
    name : str
        "white" or "patterns".
    value : float
        The largest value.
    part : float
        Part of the values that are the largest one.
    """

    name: str
    value: float
    part: float

    def __str__(self) -> str:
        seen = f"{self.part:.1%} of the values of {self.name} are exactly the largest, {self.value:.7g}"
        return f"{seen}: if the camera was saturated, take a shorter exposure, or give full_scale={self.value:.7g}"


def clipped(name: str, pictures: np.ndarray, dark: np.ndarray, good: np.ndarray, full_scale: float) -> Clipped | None:
    """Whether pictures (..., N, H, W) with N repeats pile up at a largest value below full scale.

    Noise leaves ever fewer values towards the largest one. A pile has at least 0.1 % of the values of `good` pixels,
    and more than twice as many as there are within the noise below it. Noise is that of the repeats of pixels below
    the pile, and else that of the `dark` picture (H, W). Pictures without noise have piles that mean nothing.
    """
    below_scale = np.max(pictures, tuple(range(pictures.ndim - 2))) < full_scale
    values = pictures[..., good & below_scale]  # (..., N, P)
    top = values.max() if values.size else 0
    there = int((values == top).sum())
    if there < max(FEW, PART * values.size):
        return None
    level, noise = grey_level(values.reshape(-1, values.shape[-1])[0], dark.ravel()), _noise(values, top, dark)
    below = int(((values >= top - max(noise, level)) & (values < top)).sum())
    if noise == 0 or noise < COARSE * level or there <= 2 * below:
        return None
    return Clipped(name, float(top), there / values.size)


def grey_level(*pictures: np.ndarray) -> float:
    """The step between grey levels: the smallest difference of values in pictures (P,)."""
    steps = np.diff(np.unique(np.concatenate(pictures).astype(np.float64)))
    return float(steps.min(initial=np.inf))


def _noise(values: np.ndarray, top: float, dark: np.ndarray) -> float:
    """Standard deviation of the noise of values (..., N, P) below the largest, or of the dark picture (H, W)."""
    values = values[..., :: 1 + values.shape[-1] // ENOUGH]  # standard deviations take four times the memory
    below = (values < top).all(-2)
    if values.shape[-2] > 1 and below.any():
        return float(np.percentile(values.std(-2)[below], LOUD))
    steps = np.abs(np.diff(dark.astype(np.float64), axis=-1))
    return float(1.4826 * np.median(steps) / np.sqrt(2)) if steps.size else 0.0
