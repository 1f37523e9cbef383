"""When a solver stops: a plateau, a number of iterations, a moment in time, or a failure."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

from pnp_sci._tuned import Tuned
from pnp_sci.results.history import Status
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.state import Array, State, length, missing

EXPLODED = 10.0  # relative residual that no useful iterate has: x = 0 has 1


@dataclass(frozen=True)
class StoppingNumbers(Tuned):
    """When nothing changes any more."""

    plateau: int = 5  # iterations in a row whose change must be below the tolerance


TUNED = StoppingNumbers()


class Guard:
    """Detects failures: values that are not finite, or a relative residual above 10.

    Keeps the estimate to return after a failure: the last one with the smallest relative residual. Residuals below the
    `floor`, that of the noise, count as equal.
    """

    def __init__(self, floor: float = 0.0):
        self.floor = floor
        self.best: State | None = None
        self.smallest = math.inf

    def failure(self, state: State, relative: float) -> Status | None:
        """What is wrong with an iterate of this relative residual; None if nothing."""
        if not math.isfinite(length(state.residual)):  # it is not if any value of x is not: 0 * nan is nan
            return Status.NOT_FINITE
        return Status.DIVERGED if relative > EXPLODED else None

    def keep(self, estimate: State, relative: float) -> None:
        """Remember the estimate if no other explains y better."""
        if relative <= max(self.smallest, self.floor):
            self.best, self.smallest = replace(estimate, dual=estimate.residual), min(relative, self.smallest)


class Stopping:
    """The rules that end a run without failure."""

    def __init__(self, plan: Plan, norm: float):
        self.plan, self.norm = plan, norm
        self.before: Array | None = None  # residual
        self.quiet = 0  # iterations in a row that have changed less than the tolerance
        self.slowest = 0.0  # seconds of an iteration with the prior that serves
        self.ending = 0.0  # seconds that are left for what finishes the estimate, where its pace is not known

    def reason(self, state: State, lasted: float, finishes: bool) -> Status | None:
        """Why to stop after this iterate, whose iteration lasted so many seconds; None if there is no reason.

        The next iteration is expected to take as long as the slowest one with the same prior. Time for finishing is
        reserved: where the plan does not know it, that of the slowest iteration, the first excluded.
        """
        if self.before is not None:
            change = length(state.residual - self.before) / self.norm
            small = state.iteration > self.plan.least and change < self.plan.tol
            self.quiet = self.quiet + 1 if small else 0
        self.before = state.residual
        if self.quiet >= TUNED.plateau:
            return Status.CONVERGED
        if state.iteration >= self.plan.iterations:
            return Status.ITERATIONS
        deadline = self.plan.deadline
        if deadline is not None and time.perf_counter() + self._needed(state, lasted, finishes) > deadline:
            return Status.TIME_BUDGET
        return None

    def _needed(self, state: State, lasted: float, finishes: bool) -> float:
        """Seconds for one more iteration, and for finishing."""
        due = self.plan.place(state.iteration)
        same = state.iteration == 0 or due == self.plan.place(state.iteration - 1)
        self.slowest = max(self.slowest, lasted) if same else 0.0
        if self.plan.paces:
            known = self.plan.paces[due]
            return max(self.slowest, known.slowest) + finishes * known.finish
        if finishes and state.iteration > 1:  # the first one loads and compiles
            self.ending = max(self.ending, lasted)
        return self.slowest + self.ending


def relative_residual(state: State, norm: float, saturated: Array | None) -> float:
    """``||y - Phi x|| / ||y||``; of saturated pixels only what Phi x falls short of y counts."""
    return length(missing(state.residual, saturated)) / norm
