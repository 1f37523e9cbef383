"""How much of an estimated noise is left when a decoder's estimate has been denoised."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pnp_sci.sensing.noise import noise_left
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem
from pnp_sci.solvers.backend import Backend
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.schedule import Schedule
from pnp_sci.solvers.state import State

LOOK = 2  # calls of the prior after which the residual is looked at: later ones fit the noise


class NoiseLeft:
    """Lowers the noise that a schedule is for to what the first denoised estimates leave of y.

    The estimate from y alone (:func:`pnp_sci.estimate_noise`) takes texture for noise wherever the scene is nowhere
    flat. A decoder's estimate that a strong prior has denoised explains most of that texture, and not yet the noise.
    Only a noise that was estimated, and is the same in all pixels, is lowered.

    Parameters
    ----------
    problem : Problem
    op : SensingOperator
        Of what is modelled.
    explained : bool
        Whether the first estimate is a decoder's, and the prior a strong one.
    backend : Backend
    """

    def __init__(self, problem: Problem, op: SensingOperator, explained: bool, backend: Backend):
        self.problem, self.op, self.backend = problem, op, backend
        self.noise = problem.noise
        self.due = explained and problem.estimated and np.ndim(problem.noise) == 0
        unknown = [pixels for pixels in (problem.saturated, problem.bad) if pixels is not None]
        self.known = ~np.logical_or.reduce(unknown) if unknown else None

    def __call__(self, schedule: Schedule, state: State) -> Schedule:
        """The schedule for the following iterations."""
        if state.iteration != LOOK or not self.due:
            return schedule
        left = noise_left(self.backend.get(state.residual), self.known)
        if not left < self.noise:
            return schedule
        self.noise = left
        return schedule.told(self.op, left)

    def of(self, problem: Problem) -> Problem:
        """The problem of a measurement with the noise that the solver was told in the end."""
        return replace(problem, noise=self.noise) if self.due else problem

    def planned(self, plan: Plan) -> Plan:
        """The plan for that noise."""
        return replace(plan, schedule=plan.schedule.told(self.op, float(self.noise))) if self.due else plan
