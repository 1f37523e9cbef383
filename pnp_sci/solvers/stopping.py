"""When a solver stops: a plateau, a number of iterations, a moment in time, or a failure."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.results.history import Status
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.state import Array, State, length, missing

EXPLODED = 10.0  # relative residual that no useful iterate has: x = 0 has 1
TOO_LARGE = 5.0  # length of x that no useful iterate has, in units of what y can hold: they have 0.3 to 1.5
UNEXPLAINED = 0.9  # relative residual from which an estimate, beyond the noise, explains nothing: x = 0 has 1
GROWS = 0.01  # relative growth of the length of x in an iteration that no plateau has: 0.006 around a point of light


@dataclass(frozen=True)
class StoppingNumbers(Tuned):
    """When nothing changes any more."""

    plateau: int = 5  # iterations in a row whose change must be below the tolerance


TUNED = StoppingNumbers()


class Guard:
    """Detects failures: values that are not finite, a relative residual above 10, or an x beyond what y can hold.

    Keeps the estimate to return after a failure: the last one with the smallest relative residual. Residuals below the
    `floor`, that of the noise, count as equal. Of estimates larger than what y can hold, `most`, only the first counts.
    """

    def __init__(self, floor: float = 0.0, most: float = math.inf):
        self.floor, self.most = floor, most
        self.best: State | None = None
        self.smallest = math.inf

    def failure(self, state: State, relative: float, size: float = 0.0) -> Status | None:
        """What is wrong with an iterate of this relative residual and length; None if nothing."""
        if not math.isfinite(length(state.residual)):  # it is not if any value of x is not: 0 * nan is nan
            return Status.NOT_FINITE
        return Status.DIVERGED if relative > EXPLODED or size > TOO_LARGE * self.most else None

    def keep(self, estimate: State, relative: float, size: float = 0.0) -> None:
        """Remember the estimate if no other explains y better."""
        if self.best is None or (size <= self.most and relative <= max(self.smallest, self.floor)):
            self.best, self.smallest = replace(estimate, dual=estimate.residual), min(relative, self.smallest)


class Stopping:
    """The rules that end a run without failure."""

    def __init__(self, plan: Plan, norm: float, floor: float = 0.0):
        self.plan, self.norm, self.floor = plan, norm, floor
        self.before: Array | None = None  # residual
        self.size = 0.0  # length of x
        self.quiet = 0  # iterations in a row that have changed less than the tolerance
        self.slowest = 0.0  # seconds of an iteration with the prior that serves

    def reason(
        self, state: State, lasted: float, finishes: bool, relative: float = 0.0, size: float = 0.0
    ) -> Status | None:
        """Why to stop after this iterate, whose iteration lasted so many seconds; None if there is no reason.

        It has converged if Phi x no longer changes and explains something of y. What the masks leave closed is not in
        Phi x, so that x itself, whose length is `size`, must not grow.
        The next iteration is expected to take as long as the slowest one with the same prior. The plan knows how long
        that and the finish took before.
        """
        if self.before is not None:
            change = length(state.residual - self.before) / self.norm
            small = state.iteration > self.plan.least and change < self.plan.tol
            still = small and size <= (1 + GROWS) * self.size
            self.quiet = self.quiet + 1 if still and explains(relative, self.floor) else 0
        self.before, self.size = state.residual, size
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
        known = self.plan.paces[due]
        return max(self.slowest, known.slowest) + finishes * known.finish


def relative_residual(state: State, norm: float, saturated: Array | None) -> float:
    """``||y - Phi x|| / ||y||``; of saturated pixels only what Phi x falls short of y counts."""
    return length(missing(state.residual, saturated)) / norm


def noise_floor(noise: float, y: Array) -> float:
    """The relative residual of the truth, with noise of this standard deviation."""
    return noise * math.prod(y.shape) ** 0.5 / (length(y) or 1.0)


def explains(relative: float, floor: float) -> bool:
    """Whether an estimate explains something of y: its relative residual is below 0.9, or below that of the noise."""
    return relative < max(UNEXPLAINED, floor)


def held(op: SensingOperator, y: np.ndarray) -> float:
    """Largest plausible length of x: of an x that is 1 throughout, and of the smallest one that measures y."""
    smallest = np.divide(np.square(y, dtype=np.float64), op.gram, out=np.zeros(y.shape), where=op.gram > 0)
    return math.sqrt(math.prod(op.shape) + smallest.sum())
