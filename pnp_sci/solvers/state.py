"""Where a solver stands, and what a step of a solver is."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from pnp_sci.accel.arrays import length as length
from pnp_sci.accel.arrays import library

Array = Any  # of numpy, or a tensor of torch
Denoise = Callable[[Array, float], Array]  # (v, sigma) -> x; may overwrite v


class Operator(Protocol):
    """What solvers need of Phi: :class:`~pnp_sci.SensingOperator`, or its twin on tensors."""

    @property
    def shape(self) -> tuple[int, int, int, int]:
        """(V, B, H, W)."""
        ...

    @property
    def gram(self) -> Array:
        """The diagonal of Phi Phi^T, as y."""
        ...

    def forward(self, x: Array) -> Array:
        """Phi x."""
        ...

    def project(self, x: Array, y: Array, rho: float | Array = 0.0) -> Array:
        """``x + Phi^T (y - Phi x) / (gram + rho)``."""
        ...

    def multiplier(
        self, dual: Array, residual: Array, pace: float, rho: float | Array, saturated: Array | None = None
    ) -> tuple[Array, Array]:
        """The multiplier of GAP and its move."""
        ...


@dataclass(frozen=True, eq=False)
class State:
    """Where the solver stands; arrays are tensors where it runs in torch.

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

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(32)
    >>> op = pnp_sci.SensingOperator(scene.masks)
    >>> state = next(pnp_sci.iterate(op, scene.y, "tv", op.adjoint(scene.y) / 10))
    >>> state.iteration, state.x.shape
    (0, (2, 10, 32, 32))
    """

    iteration: int
    x: Array
    residual: Array
    dual: Array
    sigma: float = float("nan")
    pace: float = 1.0


class Step(Protocol):
    """One iteration of a solver."""

    def __call__(
        self,
        op: Operator,
        y: Array,
        denoise: Denoise,
        state: State,
        sigma: float,
        rho: float | Array,
        saturated: Array | None,
    ) -> State:
        """The state after `state`, which stays as it is."""
        ...


def missing(residual: Array, saturated: Array | None) -> Array:
    """What an estimate fails to explain of y (H, W): the residual, but nothing where it exceeds a saturated y."""
    return residual if saturated is None else library(residual).where(saturated & (residual < 0), 0, residual)


def start(op: Operator, y: Array, x: Array) -> State:
    """The state before the first iteration, from a first estimate x."""
    return State(0, x, y - op.forward(x), library(y).zeros_like(y))
