"""Generalized alternating projection."""

from __future__ import annotations

import numpy as np

from ..operator import SensingOperator
from ..protocols import Denoiser
from .state import State, missing


def gap_step(
    op: SensingOperator,
    y: np.ndarray,
    denoise: Denoiser,
    state: State,
    sigma: float,
    rho: float | np.ndarray = 0.0,
    saturated: np.ndarray | None = None,
) -> State:
    """One iteration of accelerated GAP, regularised by rho.

    ``q' <- (q + y - Phi x) gram / (gram + rho);  v <- x + Phi^T (2 q' - q) / gram;  x <- D_sigma(v)``

    With ``rho = 0`` this is accelerated GAP (Liao, Li & Carin 2014; Yuan 2016, Eq. 9), where q is the accumulated
    residual and the limit measures y exactly. With ``rho > 0`` the multiplier q leaks, and the residual of the limit is
    ``rho q / gram`` instead of 0: the solver stops short of the noise. (It is the primal-dual form of ADMM for
    ``||y - Phi x||^2 / (2 rho) + prior`` in the metric of gram.) Where y is saturated the data say ``Phi x >= y``, and
    q, the multiplier of a bound, is never negative.
    """
    dual = state.dual + state.residual
    leak = np.asarray(rho, op.dtype)
    if leak.any():
        dual *= op.gram / (op.gram + leak)
    if saturated is not None:
        np.maximum(dual, 0, out=dual, where=saturated)
    measured = y - state.residual
    x = denoise(op.project(state.x, measured + 2 * dual - state.dual), sigma)
    return State(state.iteration + 1, x, y - op.forward(x), dual, sigma)


def plain_gap_step(
    op: SensingOperator,
    y: np.ndarray,
    denoise: Denoiser,
    state: State,
    sigma: float,
    rho: float | np.ndarray = 0.0,
    saturated: np.ndarray | None = None,
) -> State:
    """One iteration of GAP without acceleration: ``x <- D_sigma(x + Phi^T (y - Phi x) / (gram + rho))``.

    Where y is saturated, x that measures more than y is left alone.
    """
    target = y if saturated is None else y - state.residual + missing(state.residual, saturated)
    x = denoise(op.project(state.x, target, rho), sigma)
    return State(state.iteration + 1, x, y - op.forward(x), state.dual, sigma)
