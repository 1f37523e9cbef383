"""Takes iterates until a rule or a failure ends the run."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from pnp_sci.results.history import Record, Status
from pnp_sci.solvers.averaging import RunningMean
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.state import Array, State, length
from pnp_sci.solvers.stopping import Guard, Stopping, noise_floor, relative_residual

Score = Callable[[Array], float | None]


@dataclass
class _Clock:
    """Seconds since the run began, without those spent aside."""

    began: float
    aside: float = 0.0

    def seconds(self) -> float:
        return time.perf_counter() - self.began - self.aside


def run(
    states: Iterator[State],
    y: Array,
    plan: Plan,
    observe: Callable[[State, Record], bool],
    *,
    noise: float = 0.0,
    most: float = math.inf,
    score: Score | None = None,
    saturated: Array | None = None,
    finish: Callable[[State], State] | None = None,
) -> tuple[State, Status, list[Record]]:
    """Take states until the plan ends them, the observer asks to stop, or the guard sees a failure.

    Where the plan says so, what is observed and returned is a running mean of the iterates; the solver goes on from the
    iterates themselves, and failure and convergence are tested on them. `finish` makes of the last estimate the one
    that is returned. After a failure the last estimate with the smallest residual is returned, residuals below the
    `noise` of y counting as equal, and the records end with it. `most` is the length of x that y can hold. Time that is
    spent in `score` and `observe` is not counted.

    Returns
    -------
    State, Status, list of Record
        The last record is of the estimate that is returned.
    """
    norm = length(y) or 1.0
    floor = noise_floor(noise, y)
    clock, guard, stopping, mean = (
        _Clock(time.perf_counter()), Guard(floor, most), Stopping(plan, norm, floor), RunningMean()
    )  # fmt: skip
    records: list[Record] = []

    def record_of(state: State, seconds: float) -> Record:
        relative = relative_residual(state, norm, saturated)
        return Record(state.iteration, seconds, relative, state.sigma, score(state.x) if score else None)

    for state in states:
        relative, size = relative_residual(state, norm, saturated), length(state.x)
        failure = guard.failure(state, relative, size)
        if failure and guard.best is None:  # the first estimate itself
            return state, failure, [record_of(state, clock.seconds())]
        if failure:
            return _before_failure(guard.best, failure, records)  # type: ignore[arg-type]
        estimate = mean(state, plan.averages(state.iteration))
        now, seconds = time.perf_counter(), clock.seconds()
        records.append(record_of(estimate, seconds))
        guard.keep(estimate, records[-1].residual, size)
        asked = observe(estimate, records[-1])
        clock.aside += time.perf_counter() - now
        lasted = seconds - records[-2].seconds if len(records) > 1 else 0.0
        status = stopping.reason(state, lasted, finish is not None, relative, size)
        if asked or status:
            break
    else:
        raise AssertionError("the states have no end")
    status = Status.STOPPED if asked else status
    if finish and estimate.iteration:
        finished = finish(estimate)
        if not math.isfinite(length(finished.residual)):
            return _before_failure(guard.best or estimate, Status.NOT_FINITE, records)
        estimate, records[-1] = finished, record_of(finished, clock.seconds())
    return estimate, status, records  # type: ignore[return-value]


def _before_failure(best: State, status: Status, records: list[Record]) -> tuple[State, Status, list[Record]]:
    """The best estimate before a failure, and the records up to it."""
    return best, status, [record for record in records if record.iteration <= best.iteration]
