"""Pixels of y that the solver does not see at first, and what their prediction says of the noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from pnp_sci.sensing.noise import noise_of_prediction
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem
from pnp_sci.solvers.backend import Backend
from pnp_sci.solvers.plan import Plan
from pnp_sci.solvers.schedule import Schedule
from pnp_sci.solvers.state import State

PART = 0.02  # of the pixels of y
SEED = 2  # of their choice: not those of the judges of scene and noise, nor those of `uncertainty`


class Unseen:
    """Lowers an estimated noise to the error with which the solver predicts pixels of y that it has not seen.

    The estimate from y alone (:func:`pnp_sci.estimate_noise`) takes texture, flicker and fast motion for noise. A
    fiftieth of the pixels of y counts as infinitely noisy in the first third of the calls of the last prior. What an
    iterate leaves of them is noise and its own error, nearly independent, as only the first estimate has seen them: no
    less than the noise, in the mean. If it is less than the noise that the solver was told, the solver is told that
    from then on; so its next iterates may predict better.

    Parameters
    ----------
    problem : Problem
    op : SensingOperator
        Of what is modelled.
    plan : Plan
    wanted : bool
        Whether the noise may be lowered, if it is estimated and one number for all pixels.
    backend : Backend
        Where the solver runs.
    """

    def __init__(self, problem: Problem, op: SensingOperator, plan: Plan, wanted: bool, backend: Backend):
        self.op, self.backend, self.noise = op, backend, problem.noise
        self.last = (2 * plan.least + plan.iterations) // 3  # iteration after which all pixels are seen
        one_number = problem.estimated and np.ndim(problem.noise) == 0
        self.due = bool(wanted and one_number and problem.noise) and 0 < self.last < plan.iterations
        usable = problem.usable & ~op.unlit
        self.pixels = usable & (np.random.default_rng(SEED).random(usable.shape) < PART)

    def __call__(self, schedule: Schedule, state: State) -> Schedule:
        """The schedule for the following iterations."""
        if not self.due or state.iteration > self.last:
            return schedule
        if state.iteration == 0:
            return replace(schedule, unseen=self.backend.put(self.pixels))
        predicted = noise_of_prediction(self.backend.get(state.residual), self.pixels)
        if predicted < self.noise:
            self.noise = predicted
            schedule = schedule.told(self.op, predicted)
        return schedule if state.iteration < self.last else replace(schedule, unseen=None)

    def during(self, plan: Plan) -> Plan:
        """The plan of a solve that does not end before it has seen all pixels."""
        return replace(plan, least=max(plan.least, self.last)) if self.due else plan

    def of(self, problem: Problem) -> Problem:
        """The problem of a measurement with the noise that the solver was told in the end."""
        return replace(problem, noise=self.noise) if self.due else problem

    def describe(self, plan: Plan) -> dict[str, Any]:
        """The plan for that noise, for `Result.settings`."""
        if self.due:
            plan = replace(plan, schedule=plan.schedule.told(self.op, float(self.noise)))
        return plan.describe()
