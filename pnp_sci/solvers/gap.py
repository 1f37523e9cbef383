"""Generalized alternating projection."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.state import Denoise, State, dot, missing


@dataclass(frozen=True)
class PaceNumbers(Tuned):
    """How the pace of the multiplier follows its moves."""

    fastest: float = 5.0  # largest pace
    faster: float = 1.25  # factor of the pace after a steady move; its square divides the pace after a turn
    steady: float = 0.6  # part of a move that is found again in the next, above which it is steady
    turning: float = 0.25  # ... below which it turns


TUNED = PaceNumbers()


def gap_step(
    op: SensingOperator,
    y: np.ndarray,
    denoise: Denoise,
    state: State,
    sigma: float,
    rho: float | np.ndarray = 0.0,
    saturated: np.ndarray | None = None,
) -> State:
    """One iteration of accelerated GAP, regularised by rho, at a pace tau that follows the residuals.

    ``q' <- (q + tau (y - Phi x)) gram / (gram + tau rho);  m <- (q' - q) / tau;  v <- x + Phi^T (q' + m) / gram;
    x <- D_sigma(v)``

    With ``rho = 0`` and ``tau = 1`` this is accelerated GAP (Liao, Li & Carin 2014; Yuan 2016, Eq. 9), where q is the
    accumulated residual and the limit measures y exactly. With ``rho > 0`` the multiplier q decays: the residual of the
    limit is ``rho q / gram``, so that noise is not fitted. (With ``tau = 1`` it is the primal-dual form of ADMM for
    ``||y - Phi x||^2 / (2 rho) + prior`` in the metric of gram.) The fixed points do not depend on tau, which
    :func:`pace_after` sets. A saturated pixel is a bound ``Phi x >= y``: its multiplier q is never negative.
    """
    dual, move = _multiplier(op, state.dual, state.residual, state.pace, rho, saturated)
    x = denoise(op.project(state.x, y - state.residual + dual + move), sigma)
    residual = y - op.forward(x)
    _, following = _multiplier(op, dual, residual, state.pace, rho, saturated)
    return State(state.iteration + 1, x, residual, dual, sigma, pace_after(state.pace, move, following))


def _multiplier(
    op: SensingOperator,
    dual: np.ndarray,
    residual: np.ndarray,
    pace: float,
    rho: float | np.ndarray,
    saturated: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray]:
    """q' and m of :func:`gap_step` (H, W), 0 in pixels that every mask leaves closed."""
    from pnp_sci.sensing.kernels import multiplier

    after, move = (np.empty(dual.shape, op.dtype) for _ in range(2))
    bounds = np.empty(0, bool) if saturated is None else saturated.reshape(-1)
    with np.errstate(over="ignore"):  # an infinite rho leaves nothing of the multiplier
        rho = np.asarray(rho, op.dtype).reshape(-1)
    given, made = ([a.reshape(-1) for a in arrays] for arrays in ((dual, residual, op.gram), (after, move)))
    multiplier(*given, op.dtype.type(pace), rho, bounds, *made)
    return after, move


def pace_after(pace: float, move: np.ndarray, following: np.ndarray) -> float:
    """The pace for the next iteration, from 1 to `TUNED.fastest`, from two moves of the multiplier (H, W) in a row.

    A denoiser keeps a part d of what the multiplier adds to x: one iteration leaves ``1 - d tau`` of a residual. Strong
    denoisers keep a few per cent of fine detail, which comes slowly at ``tau = 1``. From ``d tau = 2`` on the residual
    grows. So the pace rises while moves keep their direction, and falls when they turn.

    >>> pace_after(2.0, np.ones((1, 2)), np.ones((1, 2))), pace_after(2.0, np.ones((1, 2)), -np.ones((1, 2)))
    (2.5, 1.28)
    """
    kept, square = dot(move, following), dot(move, move)
    if kept < TUNED.turning * square:
        return max(pace / TUNED.faster**2, 1.0)
    return min(TUNED.faster * pace, TUNED.fastest) if kept > TUNED.steady * square else pace


def plain_gap_step(
    op: SensingOperator,
    y: np.ndarray,
    denoise: Denoise,
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
