"""Generalized alternating projection."""

from __future__ import annotations

from dataclasses import dataclass

from pnp_sci._tuned import Tuned
from pnp_sci.accel.arrays import dot
from pnp_sci.solvers.state import Array, Denoise, Operator, State, missing


@dataclass(frozen=True)
class PaceNumbers(Tuned):
    """How the pace of the multiplier follows its moves."""

    fastest: float = 5.0  # largest pace
    faster: float = 1.25  # factor of the pace after a steady move; its square divides the pace after a turn
    steady: float = 0.6  # part of a move that is found again in the next, above which it is steady
    turning: float = 0.25  # ... below which it turns


TUNED = PaceNumbers()


def gap_step(
    op: Operator,
    y: Array,
    denoise: Denoise,
    state: State,
    sigma: float,
    rho: float | Array = 0.0,
    saturated: Array | None = None,
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
    dual, move = op.multiplier(state.dual, state.residual, state.pace, rho, saturated)
    x = denoise(op.project(state.x, y - state.residual + dual + move), sigma)
    residual = y - op.forward(x)
    _, following = op.multiplier(dual, residual, state.pace, rho, saturated)
    return State(state.iteration + 1, x, residual, dual, sigma, pace_after(state.pace, move, following))


def pace_after(pace: float, move: Array, following: Array) -> float:
    """The pace for the next iteration, from 1 to `TUNED.fastest`, from two moves of the multiplier (H, W) in a row.

    A denoiser keeps a part d of what the multiplier adds to x: one iteration leaves ``1 - d tau`` of a residual. Strong
    denoisers keep a few per cent of fine detail, which comes slowly at ``tau = 1``. From ``d tau = 2`` on the residual
    grows. So the pace rises while moves keep their direction, and falls when they turn.

    >>> import numpy as np
    >>> pace_after(2.0, np.ones((1, 2)), np.ones((1, 2))), pace_after(2.0, np.ones((1, 2)), -np.ones((1, 2)))
    (2.5, 1.28)
    """
    kept, square = (dot(move, m) for m in (following, move))
    if kept < TUNED.turning * square:
        return max(pace / TUNED.faster**2, 1.0)
    return min(TUNED.faster * pace, TUNED.fastest) if kept > TUNED.steady * square else pace


def plain_gap_step(
    op: Operator,
    y: Array,
    denoise: Denoise,
    state: State,
    sigma: float,
    rho: float | Array = 0.0,
    saturated: Array | None = None,
) -> State:
    """One iteration of GAP without acceleration: ``x <- D_sigma(x + Phi^T (y - Phi x) / (gram + rho))``.

    Where y is saturated, x that measures more than y is left alone.
    """
    target = y if saturated is None else y - state.residual + missing(state.residual, saturated)
    x = denoise(op.project(state.x, target, rho), sigma)
    return State(state.iteration + 1, x, y - op.forward(x), state.dual, sigma)
