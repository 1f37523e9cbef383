"""The one loop for all solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from pnp_sci._validate import finite_number, needed, one_of, shaped
from pnp_sci.accel.arrays import like
from pnp_sci.plugins.combine import InTurn, turns
from pnp_sci.plugins.resolve import as_prior
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.admm import admm_step
from pnp_sci.solvers.displacement import FAINT, displace
from pnp_sci.solvers.gap import gap_step, plain_gap_step
from pnp_sci.solvers.schedule import Schedule, schedule_for
from pnp_sci.solvers.state import Array, Operator, State, Step, start

ALGORITHMS: dict[str, Step] = {"gap": gap_step, "plain-gap": plain_gap_step, "admm": admm_step}


def iterate(
    op: SensingOperator,
    y: np.ndarray,
    prior: Any,
    x: np.ndarray,
    *,
    algorithm: str = "gap",
    noise: float | np.ndarray = 0.0,
    sigma: float | None = None,
    saturated: np.ndarray | None = None,
) -> Iterator[State]:
    """The iterates of a solver, without end: take as many as you like.

    Parameters
    ----------
    op : SensingOperator
        For consecutive measurements of one video a :class:`pnp_sci.SequenceOperator`.
    y : ndarray, (H, W), or (N, H, W) of consecutive measurements
        In units where x spans about [0, 1].
    prior : Prior, or what :func:`pnp_sci.as_prior` takes
    x : ndarray, (V, B, H, W)
        The first estimate.
    algorithm : "gap", "plain-gap" or "admm"
    noise : float or ndarray, like y
        Standard deviation of the noise of y, or of each of its pixels; sets how far the data are trusted.
    sigma : float, optional
        What the prior is called with; by default a rule decides, see :mod:`pnp_sci.solvers.schedule`. It does not fall
        here, as there is no last iteration.
    saturated : ndarray of bool, like y, optional
        Pixels in which Phi x may be y or more.

    Yields
    ------
    State
        First the state before iteration 1, then one per iteration; none is changed later.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used, or what the prior returns.

    Examples
    --------
    >>> import itertools
    >>> import numpy as np, pnp_sci
    >>> op = pnp_sci.SensingOperator(np.ones((1, 2, 8, 8)))
    >>> states = iterate(op, np.ones((8, 8)), "none", np.zeros(op.shape), algorithm="plain-gap")
    >>> [float(abs(s.residual).max()) for s in itertools.islice(states, 2)]
    [1.0, 0.0]
    """
    needed("op", op, SensingOperator)
    one_of("algorithm", algorithm, ALGORITHMS)
    y, x = shaped("y", y, op.pictures, op.dtype), shaped("x", x, op.shape, op.dtype)
    noise = shaped("noise", noise, op.pictures, op.dtype) if np.ndim(noise) else finite_number("noise", noise)
    sigma = None if sigma is None else finite_number("sigma", sigma)
    session = InTurn(turns(as_prior(prior), op.shape), op.shape, op.dtype)
    return states(op, y, session, x, ALGORITHMS[algorithm], schedule_for(op, noise, sigma), saturated)


def states(
    op: Operator,
    y: Array,
    session: InTurn,
    x: Array,
    step: Step,
    schedule: Schedule,
    saturated: Array | None = None,
    revise: Callable[[Schedule, State], Schedule] = lambda schedule, _: schedule,
) -> Iterator[State]:
    """The iterates of :func:`iterate`, with a session of the prior and a schedule; `revise` may change that."""
    gram = float(op.gram.mean()) or np.inf  # without any mask nothing of the noise comes into x
    in_x = schedule.mean_product() / gram
    state = start(op, y, x)
    del x  # as large as all that a step needs
    while True:
        yield state
        revised = revise(schedule, state)
        if revised is not schedule:
            schedule, in_x = revised, revised.mean_product() / gram
        sigma, rho = schedule.at(state.iteration)
        state = rescaled(state, sigma)
        state = step(op, y, partial(_denoised, session, state.x, in_x), state, sigma, rho, saturated)


def rescaled(state: State, sigma: float) -> State:
    """The state for a step with `sigma`: what the solver has accumulated is in units of it."""
    if state.iteration == 0 or sigma == state.sigma:
        return state
    return replace(state, dual=state.dual * (sigma / state.sigma), sigma=sigma)


def _denoised(session: InTurn, x: Array, in_x: float, v: Array, sigma: float) -> Array:
    """The solver's own v, overwritten by what the session returns, so that a prior may reuse its buffers.

    For a prior that follows motion, v is displaced first, as it pulls at the estimate x. It holds noise that the prior
    is to remove, sigma, and that of y: rho / gram, with `in_x` the mean of sigma * rho / gram. Values that are not
    finite are left to the guard.
    """
    if sigma >= FAINT and session.due(sigma).motion:
        displace(x, v, sigma + in_x / sigma)
    denoised = session(v, sigma, out=v)
    if denoised is not v:
        v[...] = like("what the prior returns", denoised, v)
    return v
