"""The one loop for all solvers, and the guard that ends it."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.plugins.combine import reset
from pnp_sci.plugins.protocols import Denoiser
from pnp_sci.results.result import Record, Status
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers import ALGORITHMS, State, missing, start
from pnp_sci.solvers.plan import schedule_for

EXPLODED = 10.0  # relative residual that no useful iterate has: x = 0 has 1
# Later iterates count more in a mean: the n-th about n to this power. On seven validation clips of 256 x 256, after 30
# calls of `video` and `flow`, 3 and 8 are as good in the mean, within 0.01 dB; but where estimates still rise, with two
# views of 10 and 14 frames, 3 is up to 0.05 dB worse, and where they only flicker, with one view of 8, 8 is 0.09 worse.
POWER = 5
PLATEAU = 5  # iterations in a row that must be below the tolerance


def iterate(
    op: SensingOperator,
    y: np.ndarray,
    denoiser: Denoiser,
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
    y : ndarray, (H, W)
        In units where x spans about [0, 1].
    denoiser : Denoiser
        Called ``denoiser(x, sigma)``; its memory is reset first.
    x : ndarray, (V, B, H, W)
        The first estimate.
    algorithm : "gap", "plain-gap" or "admm"
    noise : float or ndarray, (H, W)
        Standard deviation of the noise of y, or of each of its pixels; sets how far the data are trusted, see
        :mod:`pnp_sci.solvers.plan`.
    sigma : float, optional
        What the denoiser is called with; by default a rule decides.
    saturated : ndarray of bool, (H, W), optional
        Pixels in which Phi x may be y or more.

    Yields
    ------
    State
        First the state before iteration 1, then one per iteration; none is changed later.

    Examples
    --------
    >>> import itertools
    >>> import numpy as np, pnp_sci
    >>> op = pnp_sci.SensingOperator(np.ones((1, 2, 8, 8)))
    >>> states = iterate(op, np.ones((8, 8)), lambda x, sigma: x, np.zeros(op.shape), algorithm="plain-gap")
    >>> [float(abs(s.residual).max()) for s in itertools.islice(states, 2)]
    [1.0, 0.0]
    """
    step = ALGORITHMS[algorithm]
    plan = schedule_for(op, noise, sigma)
    denoise = _checked(op, _in_place(denoiser))
    reset(denoiser)
    state = start(op, y, x)
    del x  # as large as all that a step needs
    while True:
        yield state
        strength, rho = plan.at(state.iteration)
        if state.iteration and strength != state.sigma:  # what the solver has accumulated is in units of sigma
            state = replace(state, dual=state.dual * op.dtype.type(strength / state.sigma))
        state = step(op, y, denoise, state, strength, rho, saturated)


def _in_place(denoiser: Denoiser) -> Denoiser:
    """The solver's own v is free to be overwritten: a denoiser that takes ``out`` need not allocate."""
    try:
        takes_out = "out" in inspect.signature(denoiser).parameters
    except (TypeError, ValueError):  # some builtins tell nothing of themselves
        return denoiser
    return (lambda v, sigma: denoiser(v, sigma, out=v)) if takes_out else denoiser  # type: ignore[call-arg]


def _checked(op: SensingOperator, denoiser: Denoiser) -> Denoiser:
    """The denoiser, held to what it has to return; values that are not finite are left to the guard."""
    return lambda x, sigma: shaped("what the prior returns", denoiser(x, sigma), op.shape, op.dtype)


@dataclass(frozen=True)
class Limits:
    """When to stop: after so many iterations, at so small a change, at a moment of ``time.perf_counter``.

    A change counts as small only after `least` iterations.
    """

    iterations: int
    tol: float
    deadline: float | None = None
    least: int = 0


def run(
    states: Iterator[State],
    y: np.ndarray,
    limits: Limits,
    observe: Callable[[State, Record], bool],
    psnr: Callable[[np.ndarray], float | None] | None = None,
    saturated: np.ndarray | None = None,
    restless: Callable[[], bool] = bool,
    finish: Callable[[State], State] | None = None,
) -> tuple[State, Status, list[Record]]:
    """Take states until a limit is met, the observer asks to stop, or the guard sees a failure.

    The guard returns the last estimate before the residual left the range of useful ones for good, or the last finite
    one. Time spent in `psnr` and `observe` is not counted.
    While the denoiser is `restless`, what is observed and returned is the mean of all iterates since it became so, the
    n-th of them weighted with n (n + 1) ... (n + 4) (Shamir & Zhang, ICML 2013). Each new measurement of motion or
    likeness moves the iterates, and so does what the solver demands ever more loudly because the denoiser does not
    believe it; what they have in common is nearer to the truth. The solver goes on from the iterates, and guard and
    plateau look at them.
    `finish` makes of the last estimate the one that is returned, unless the guard ends the run or nothing has been
    denoised; the last record is of that one. As much time as the slowest iteration but the first took is left for it.
    """
    norm = length(y) or 1.0
    begin, aside = time.perf_counter(), 0.0
    records: list[Record] = []
    estimate, good, before, quiet, slowest, ending = None, None, None, 0, 0.0, 0.0
    averaged = 0  # iterates in the mean

    def record_of(state: State, seconds: float) -> Record:
        relative = length(missing(state.residual, saturated)) / norm
        return Record(state.iteration, seconds, relative, state.sigma, psnr(state.x) if psnr else None)

    for state in states:
        relative = length(missing(state.residual, saturated)) / norm
        if not np.isfinite(length(state.residual)):  # it is not if any value of x is not: 0 * nan is nan
            return good or state, Status.NOT_FINITE, records
        if relative > EXPLODED:
            return good or state, Status.DIVERGED, records
        averaged = averaged + 1 if state.iteration and restless() else 0
        estimate = _mean(estimate, state, (POWER + 1) / (averaged + POWER)) if estimate and averaged > 1 else state
        if good is None or relative <= 1.0:
            good = estimate
        now = time.perf_counter()
        record = record_of(estimate, now - begin - aside)
        lasted = record.seconds - records[-1].seconds if records else 0.0
        slowest = max(slowest, lasted)
        if finish and state.iteration > 1:  # the first one loads and compiles
            ending = max(ending, lasted)
        records.append(record)
        stop = observe(estimate, record)
        aside += time.perf_counter() - now
        if before is not None:
            small = state.iteration > limits.least and length(state.residual - before) / norm < limits.tol
            quiet = quiet + 1 if small else 0
        before = state.residual
        late = limits.deadline is not None and time.perf_counter() + slowest + ending > limits.deadline
        if stop or quiet >= PLATEAU or state.iteration >= limits.iterations or late:
            break
    else:
        raise AssertionError("iterate() has no end")
    if finish and estimate.iteration:
        finished = finish(estimate)
        if not np.isfinite(length(finished.residual)):
            return estimate, Status.NOT_FINITE, records
        estimate = finished
        records[-1] = record_of(estimate, time.perf_counter() - begin - aside)
    if stop:
        return estimate, Status.STOPPED, records
    if quiet >= PLATEAU:
        return estimate, Status.CONVERGED, records
    return estimate, Status.ITERATIONS if state.iteration >= limits.iterations else Status.TIME_BUDGET, records


def _mean(before: State, state: State, share: float) -> State:
    """`state` with a mean of both estimates, in which its own has so large a share, and the residual of that."""
    x, residual = before.x - state.x, before.residual - state.residual
    for mean, newest in ((x, state.x), (residual, state.residual)):
        mean *= mean.dtype.type(1 - share)
        mean += newest
    return replace(state, x=x, residual=residual)


def length(picture: np.ndarray) -> float:
    """Euclidean norm. BLAS would do it with threads that go on spinning, and keep the kernels' threads waiting."""
    return float(np.sqrt(np.einsum("ij,ij", picture, picture)))
