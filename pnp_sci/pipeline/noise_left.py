"""How much of an estimated noise is left when a decoder's estimate has been denoised."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from pnp_sci.sensing.noise import noise_left
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem
from pnp_sci.solvers.backend import Backend
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.schedule import Schedule
from pnp_sci.solvers.state import State

LOOK = 2  # calls of the prior after which the residual is looked at: later ones fit the noise
LEAST = 0.5  # of the estimate from y: texture makes it no more than twice too large where something is flat


class NoiseLeft:
    """Lowers the noise that a schedule is for to what the first denoised estimates leave of y.

    The estimate from y alone (:func:`pnp_sci.estimate_noise`) takes texture for noise if no part of the scene is flat.
    A decoder's estimate that a strong prior has denoised explains most of that texture, and not yet the noise.

    Parameters
    ----------
    problem : Problem
        Its noise is lowered if it was estimated.
    op : SensingOperator
        Of what is modelled.
    explained : bool
        Whether the first estimate is a decoder's, the prior a strong one, and sigma as the rule says: otherwise the
        first calls explain too little or too much.
    backend : Backend
        Where the solver runs.
    """

    def __init__(self, problem: Problem, op: SensingOperator, explained: bool, backend: Backend):
        self.op, self.backend, self.noise = op, backend, problem.noise
        self.due = explained and problem.estimated
        self.known = op.gram > 0  # where no mask is open, as in bad pixels, the video explains nothing
        if problem.saturated is not None:
            self.known &= ~problem.saturated

    def __call__(self, schedule: Schedule, state: State) -> Schedule:
        """The schedule for the following iterations."""
        if state.iteration != LOOK or not self.due:
            return schedule
        left = noise_left(self.backend.get(state.residual), self.known)
        if not left < self.noise:
            return schedule
        self.noise = max(left, LEAST * float(self.noise))
        return schedule.told(self.op, self.noise)

    def of(self, problem: Problem) -> Problem:
        """The problem of a measurement with the noise that the solver was told in the end."""
        return replace(problem, noise=self.noise) if self.due else problem

    def describe(self, plan: Plan) -> dict[str, Any]:
        """The plan for that noise, for `Result.settings`."""
        if self.due:
            plan = replace(plan, schedule=plan.schedule.told(self.op, float(self.noise)))
        return plan.describe()
