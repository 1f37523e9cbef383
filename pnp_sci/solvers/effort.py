"""How many calls of a prior an effort makes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pnp_sci._tuned import Tuned
from pnp_sci.plugins.protocols import Prior
from pnp_sci.solvers.schedule import Schedule


@dataclass(frozen=True)
class EffortNumbers(Tuned):
    """Calls of an effort, after a warm-up."""

    plain: int = 100  # calls of a plain prior, balanced; half as many fast, twice as many for the best
    fast: int = 20  # calls of a strong prior
    work: int = 600  # calls times frames of all views, balanced
    per_frame: float = 1.5  # calls for each frame of all views, balanced, where that is more
    best: int = 50  # calls of a strong prior, best; upper limit of balanced


TUNED = EffortNumbers()
EFFORTS = {"fast": 0.5, "balanced": 1, "best": 2}  # calls of a plain prior, in those of the balanced effort


def calls_for(effort: str, prior: Prior, shape: Sequence[int], schedule: Schedule) -> int:
    """How many calls of a prior an effort allows for videos of this shape, its warm-up not included.

    A strong prior has more calls for few frames, which cost little, and for many frames, which converge slowly. With
    noise it has fewer.
    """
    if not prior.traits(tuple(shape)).strong:
        return round(EFFORTS[effort] * TUNED.plain)
    frames = shape[0] * shape[1]
    balanced = min(round(max(TUNED.work / frames, TUNED.per_frame * frames)), TUNED.best)
    return schedule.enough(TUNED.fast, {"fast": TUNED.fast, "balanced": balanced, "best": TUNED.best}[effort])
