"""Where a solver stands, and what a step of a solver is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from pnp_sci.sensing.operator import SensingOperator

Denoise = Callable[[np.ndarray, float], np.ndarray]  # (v, sigma) -> x; may overwrite v


@dataclass(frozen=True, eq=False)
class State:
    """Where the solver stands.

    Attributes
    ----------
    iteration : int
    x : ndarray, (V, B, H, W)
        The estimate, in units where it spans about [0, 1].
    residual : ndarray, (H, W)
        ``y - Phi x``.
    dual : ndarray, (H, W) or (V, B, H, W)
        What the solver has accumulated: GAP a multiplier per pixel of y, ADMM one per pixel of x.
    sigma : float
        What the denoiser was called with to get x; NaN for the first estimate.
    pace : float
        How many residuals GAP adds to its multiplier in the next iteration.
    """

    iteration: int
    x: np.ndarray
    residual: np.ndarray
    dual: np.ndarray
    sigma: float = float("nan")
    pace: float = 1.0


class Step(Protocol):
    """One iteration of a solver."""

    def __call__(
        self,
        op: SensingOperator,
        y: np.ndarray,
        denoise: Denoise,
        state: State,
        sigma: float,
        rho: float | np.ndarray,
        saturated: np.ndarray | None,
    ) -> State:
        """The state after `state`, which stays as it is."""
        ...


def missing(residual: np.ndarray, saturated: np.ndarray | None) -> np.ndarray:
    """What an estimate fails to explain of y (H, W): the residual, but nothing where it exceeds a saturated y."""
    return residual if saturated is None else np.where(saturated, np.maximum(residual, 0), residual)


def start(op: SensingOperator, y: np.ndarray, x: np.ndarray) -> State:
    """The state before the first iteration, from a first estimate x."""
    return State(0, x, y - op.forward(x), np.zeros_like(y))


def length(picture: np.ndarray) -> float:
    """Euclidean norm of (..., H, W); einsum does not start threads, which would disturb those of the kernels."""
    return float(np.sqrt(dot(picture, picture)))


def dot(one: np.ndarray, other: np.ndarray) -> float:
    """Inner product of pictures (..., H, W)."""
    return float(np.einsum("i,i", one.reshape(-1), other.reshape(-1)))
