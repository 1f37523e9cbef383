"""What a plugin must be. This module imports nothing of ours."""

from __future__ import annotations

from typing import TYPE_CHECKING, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np

    from .operator import SensingOperator


@runtime_checkable
class Denoiser(Protocol):
    """A prior, seen through its denoiser.

    Called with ``x`` (V, B, H, W), values about [0, 1], and ``sigma`` >= 0, the standard deviation of the noise in the
    same units. Returns a new array of the same shape and dtype. Views must not be mixed.

    One with a memory has ``reset()``. One with a true attribute ``thorough`` or ``learned``, whose calls do more than
    those of TV, is called fewer times, and the fewer the more noise there is, after as many as its ``first`` leaves to
    TV (30); one that is ``learned`` starts from a network's estimate unless another is asked for. While an attribute
    ``restless`` is true, since its calls move the estimates to and fro, solve returns a mean of them.
    What ``finish(x, sigma)`` makes of the last estimate takes its place, unless the solver has failed. A joint prior is
    restless while one of its members is, and finishes as those do that can; stages are asked for neither.
    ``at_rest``, a list of the part of each view that stands still, goes into ``Result.scene``; stages are not asked.
    """

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W)."""
        ...


@runtime_checkable
class Initializer(Protocol):
    """Gives the solver its first estimate, from a measurement in units where x spans about [0, 1]."""

    def __call__(self, op: SensingOperator, y: np.ndarray) -> np.ndarray:
        """A video (V, B, H, W) from y (H, W)."""
        ...


@runtime_checkable
class Decoder(Protocol):
    """Reconstructs on its own, from a measurement in units where x spans about [0, 1]."""

    def __call__(self, op: SensingOperator, y: np.ndarray) -> np.ndarray:
        """A video (V, B, H, W) from y (H, W)."""
        ...
