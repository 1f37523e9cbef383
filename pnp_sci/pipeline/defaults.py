"""What ``solve`` does where its arguments leave it open: the prior, how many iterations, what of a scene to model."""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec
from typing import Any

import numpy as np

from pnp_sci._validate import one_of
from pnp_sci.advice.recommend import LEARNED
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import FIRST
from pnp_sci.scene.select import judge, patience
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.solvers.plan import Schedule

EFFORTS = {"fast": 50, "balanced": 100, "best": 200}  # iterations; TV has converged to 0.05 dB by 100 on training clips
# With fewer than so many frames of all views, a part less for each: on clips of the validation `tv` is as good after
# these as after 100.
FEW, SOONER = 4, 0.15
# Of a thorough prior, after those that it leaves to TV: so many for each frame of all views, but 30 to 50; 20 with the
# fast effort. On clips of the validation `video` has 30.0 dB with two views of 10 frames after 50 of these and after
# 80; two views of 6 have as much after 30 as after 50, one of 8 as much after 20.
PER_FRAME = {"fast": 0, "balanced": 1.5, "best": 2.5}
LEAST, MOST = {"fast": 20, "balanced": 30, "best": 30}, 50
AUTO = {"fast": "tv", "balanced": "video", "best": "both"}  # what "auto" stands for
AUTO_UNLEARNED = {"fast": "tv", "balanced": "flow", "best": "flow"}  # where PyTorch is missing
# Options of `flow` with which the judge's limits were chosen. Neither prior may find by itself what stands still: the
# models to be compared would be alike.
JUDGED_WITH = {"neighbours": 2, "tolerance": 3.0, "still": False}
SMALLEST = 32  # pixels a side: `flow` leaves smaller pictures to TV, and could not tell what moves
QUICK = ("tv", "wavelet", "none")  # priors that make no more of a scene than its judge does


def prior_for(effort: str) -> str:
    """What the prior "auto" stands for, without a time budget."""
    one_of("effort", effort, EFFORTS)
    return AUTO[effort] if all(map(find_spec, LEARNED)) else AUTO_UNLEARNED[effort]


def most_iterations(effort: str, first: int | None, frames: int, plan: Schedule | None = None) -> int:
    """How many iterations an effort allows if so many frames are modelled.

    The `first` of a thorough prior are those that it leaves to TV, and noise takes some of the others; a plain prior
    has None.
    """
    if first is None:
        return max(EFFORTS["fast"], round(EFFORTS[effort] * (1 - SOONER * max(FEW - frames, 0))))
    calls = round(min(max(PER_FRAME[effort] * frames, LEAST[effort]), MOST))
    return max(first, FIRST) + (plan.enough(calls) if plan else calls)


def choose_scene(scene: str | SceneModel, problem: Problem, prior: Any = None, until: float = np.inf) -> SceneModel:
    """The model that a `scene` argument of :func:`solve` stands for.

    Quick estimates are made with TV and, where they leave it open and the `prior` is no quick one itself, with flow.
    Single views that stand still beside others are looked for if a `prior` is given that is no quick one. `until` is a
    moment of ``time.perf_counter``, after which no simpler model is taken.
    """
    if isinstance(scene, SceneModel):
        return scene
    if scene == "full" or "tv" not in registry.available("priors"):
        return full(problem.op)
    tv = partial(registry.load("priors", "tv"), still=False)
    small = min(problem.op.shape[2:]) < SMALLEST
    if prior in QUICK or small or "flow" not in registry.available("priors"):
        return judge(problem, tv, until=until)
    flow = partial(registry.load("priors", "flow"), first=patience(problem.op) // 2, **JUDGED_WITH)
    return judge(problem, tv, flow, each_view=prior is not None, until=until)
