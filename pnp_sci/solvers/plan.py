"""All that is decided before the first iteration: which prior serves when, sigma and rho, and the limits."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci.plugins.combine import Joint, Stages, Turn, serving, turns
from pnp_sci.plugins.mosaic import Mosaicked
from pnp_sci.plugins.protocols import Prior
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.effort import calls_for
from pnp_sci.solvers.schedule import Schedule, contrast, schedule_for


@dataclass(frozen=True)
class Pace:
    """Seconds that iterations with a prior take, or seconds for each value of x.

    Attributes
    ----------
    slowest, usual : float
        Of an iteration. The slowest ones measure the motion or group patches, the first one always.
    finish : float
        Of what makes of the last estimate the one that is returned.
    """

    slowest: float = 0.0
    usual: float = 0.0
    finish: float = 0.0

    def times(self, factor: float) -> Pace:
        """The pace of so many times the work."""
        return Pace(self.slowest * factor, self.usual * factor, self.finish * factor)


@dataclass(frozen=True, eq=False)
class Plan:
    """What the solver does, decided before the first iteration.

    Attributes
    ----------
    algorithm : "gap", "plain-gap" or "admm"
    serves : tuple of Turn
        Which prior serves from which iteration on.
    schedule : Schedule
        sigma and rho of every iteration.
    iterations : int
        The largest number.
    tol : float
        A change of Phi x by less than this share of ``||y||`` counts as none; `tol` times the contrast of the masks.
    least : int
        Iterations before which no change counts as none: those before the last prior serves and all pixels are seen.
    deadline : float or None
        The moment of ``time.perf_counter`` by which the solver returns.
    paces : tuple of Pace
        How long iterations with each of `serves` take, if there is a deadline.
    """

    algorithm: str
    serves: tuple[Turn, ...]
    schedule: Schedule
    iterations: int
    tol: float
    least: int = 0
    deadline: float | None = None
    paces: tuple[Pace, ...] = ()

    def place(self, call: int) -> int:
        """The place in `serves` of the turn that serves a call, counted from 0."""
        return serving(self.serves, call, self.schedule.at(call)[0])

    def averages(self, iteration: int) -> bool:
        """Whether the estimate of this iteration, counted from 1, is averaged with those before."""
        call = iteration - 1
        return call >= 0 and self.serves[self.place(call)].average

    def describe(self) -> dict[str, Any]:
        """For `Result.settings`, as JSON can hold it: what the planned iterations do."""
        calls = range(self.iterations)
        # no turn comes back, as sigma never rises
        first = [bisect_left(calls, place, key=self.place) for place in range(len(self.serves))]
        sigma, rho = self.schedule.at(self.iterations - 1)
        return {
            "algorithm": self.algorithm,
            "serves": [
                {"name": _name(turn.prior), "prior": repr(turn.prior), "from": begins}
                for turn, begins, ends in zip(self.serves, first, [*first[1:], self.iterations])
                if begins < ends
            ],
            "sigma": [self.schedule.sigma, sigma],
            "rho": float(np.mean(rho)),
            "iterations": self.iterations,
            "tol": self.tol,
        }


def make_plan(
    op: SensingOperator,
    noise: float | np.ndarray,
    prior: Prior,
    *,
    algorithm: str = "gap",
    effort: str = "balanced",
    iterations: int | None = None,
    sigma: float | None = None,
    tol: float = 8e-5,
    decoded: bool = False,
    deadline: float | None = None,
) -> Plan:
    """The plan for a measurement with this operator and noise, in units where x spans [0, 1].

    A decoder's estimate needs no warm-up: total variation would undo a part of it.

    Parameters
    ----------
    op : SensingOperator
        Of what is modelled.
    noise : float or ndarray, (H, W)
    prior : Prior
    algorithm, effort, iterations, sigma, tol
        As for :func:`pnp_sci.solve`.
    decoded : bool
        Whether the first estimate is a decoder's.
    deadline : float, optional
    """
    order, schedule = turns(prior, op.shape, warm=not decoded), schedule_for(op, noise, sigma)
    if iterations is None:
        iterations = prior.calls if isinstance(prior, Stages) else None
    if iterations is None:
        iterations = order[-1].begins + calls_for(effort, prior, op.parts[0].shape, schedule)
    if prior.traits(op.shape).strong:
        schedule = schedule.settling(order[-1].begins, iterations - 1)
    return Plan(algorithm, order, schedule, iterations, tol * contrast(op), order[-1].begins, deadline)


def _name(prior: Prior) -> str:
    """A word for a prior: its class, or those of its members."""
    if isinstance(prior, Mosaicked):
        return _name(prior.prior)
    return " + ".join(map(_name, prior.members)) if isinstance(prior, Joint) else type(prior).__name__
