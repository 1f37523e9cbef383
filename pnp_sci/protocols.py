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
    """

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray: ...


@runtime_checkable
class Initializer(Protocol):
    """Gives the solver its first estimate: (V, B, H, W) from a measurement (H, W) in units where x spans about [0, 1]."""

    def __call__(self, op: SensingOperator, y: np.ndarray) -> np.ndarray: ...


@runtime_checkable
class Decoder(Protocol):
    """Reconstructs on its own: (V, B, H, W) from a measurement (H, W) in units where x spans about [0, 1]."""

    def __call__(self, op: SensingOperator, y: np.ndarray) -> np.ndarray: ...
