"""Motion of all views of a video, of arrays or of tensors."""

from __future__ import annotations

from functools import cached_property
from typing import Any, Protocol

import numpy as np

from priors.motion.measure import TUNED, Motion, measure


class VideoMotion(Protocol):
    """The motion of each view, and the averages along it."""

    @property
    def at_rest(self) -> list[float]:
        """Fraction of the pixels of each view that are still, 0 to 1."""
        ...

    @property
    def remaining(self) -> Any:
        """Factor of the averages on the standard deviation of white noise, float32 (V, B, H, W)."""
        ...

    def average(self, x: Any) -> Any:
        """Each frame of x (V, B, H, W) averaged with its neighbours along the motion, as a new array."""
        ...


class OfArrays:
    """The motion of each view of an array."""

    def __init__(self, views: list[Motion]):
        self.views = views

    @property
    def at_rest(self) -> list[float]:
        """Fraction of the pixels of each view that are still, 0 to 1."""
        return [view.at_rest for view in self.views]

    @cached_property
    def remaining(self) -> np.ndarray:
        """Factor of the averages on the standard deviation of white noise, float32 (V, B, H, W)."""
        return np.stack([view.remaining for view in self.views])

    def average(self, x: np.ndarray) -> np.ndarray:
        """Each frame of x (V, B, H, W) averaged with its neighbours along the motion, as a new array."""
        out = np.empty_like(x)
        for view, motion, mean in zip(x, self.views, out):
            motion.average(view, mean)
        return out


def seen(
    x: Any, neighbours: int, tolerance: float, drift: float, rest: float, before: VideoMotion | None = None
) -> VideoMotion:
    """The motion of each view of x (V, B, H, W); arguments as for :func:`priors.motion.measure.measure`."""
    if not isinstance(x, np.ndarray):
        from priors.motion.tensors import measured

        return measured(x, neighbours, tolerance, drift, rest, before)
    views = before.views if isinstance(before, OfArrays) else [None] * len(x)
    return OfArrays([measure(view, neighbours, tolerance, drift, rest, last) for view, last in zip(x, views)])


def finished(x: Any, sigma: float, neighbours: int, drift: float, rest: float) -> Any:
    """Average a solver's last estimate x (V, B, H, W) along the motion estimated from x itself.

    `sigma` is the solver's last sigma. The other arguments are as for :func:`seen`, with the values used during the
    iterations. Returns a new array.
    """
    return seen(x, neighbours, TUNED.certain * sigma, drift, TUNED.certain * rest).average(x)
