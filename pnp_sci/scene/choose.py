"""The scene model that an argument `scene` stands for."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.plugins import registry
from pnp_sci.plugins.resolve import as_prior
from pnp_sci.scene.select import judge, patience
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel, full

QUICK, CAREFUL = "tv", "flow"  # priors of the estimates that are compared; neither may find by itself what is still
SMALLEST = 32  # pixels a side: smaller pictures show no motion


@dataclass(frozen=True)
class JudgeNumbers(Tuned):
    """Options of the careful prior: averages of few frames leave a moving scene its motion."""

    neighbours: int = 2  # frames either side that help a frame
    tolerance: float = 3.0  # difference at which one of them counts 1/e, in units of sigma


TUNED = JudgeNumbers()


def choose_scene(
    scene: str | SceneModel,
    problem: Problem,
    careful: bool = True,
    each_view: bool = False,
    until: float = np.inf,
) -> SceneModel:
    """What of a scene is modelled.

    Parameters
    ----------
    scene : "auto", "full" or SceneModel
    problem : Problem
    careful : bool
        Whether estimates with optical flow decide where quick ones leave it open: for strong priors and networks.
    each_view : bool
        Whether single views that stand still beside others are looked for.
    until : float
        A moment of ``time.perf_counter``, after which no simpler model is taken.
    """
    if isinstance(scene, SceneModel):
        return scene
    installed = registry.available("priors")
    if scene == "full" or QUICK not in installed:
        return full(problem.op)
    quick = as_prior(QUICK, still=False)
    if not careful or min(problem.op.shape[2:]) < SMALLEST or CAREFUL not in installed:
        return judge(problem, quick, until=until)
    flow = as_prior(CAREFUL, first=patience(problem.op) // 2, still=False, **asdict(TUNED))
    return judge(problem, quick, flow, each_view, until)
