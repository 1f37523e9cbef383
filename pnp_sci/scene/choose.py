"""The scene model that an argument `scene` stands for."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.plugins import registry
from pnp_sci.scene.judge import judge, patience
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel, full

QUICK = "tv"  # priors of the estimates that are compared, with still=False: the scene model is tested
CAREFUL = "flow"
SMALLEST = 32  # pixels a side: smaller pictures show no motion
TOO_SMALL = f"not judged: a mosaic of fewer than {SMALLEST} pixels a side"
NOT_INSTALLED = "not judged: the prior {} is not installed"


@dataclass(frozen=True)
class JudgeNumbers(Tuned):
    """Options of the careful prior: averages of few frames leave a moving scene its motion.

    Frames are not displaced, and the motion is measured in every fourth call: the limits of the judge were found so.
    """

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
        They always do for mosaics, whose planes have too few pixels for quick ones.
    each_view : bool
        Whether single views that stand still beside others are looked for.
    until : float
        A moment of ``time.perf_counter``, after which no simpler model is taken.
    """
    if isinstance(scene, SceneModel):
        return scene
    tv, flow = (registry.installed("priors", name) for name in (QUICK, CAREFUL))
    if scene == "full":
        return full(problem.op)
    if tv is None:
        return full(problem.op, NOT_INSTALLED.format(QUICK))
    quick, mosaic, small = tv(still=False), problem.balance is not None, min(problem.op.shape[2:]) < SMALLEST
    if mosaic and (small or flow is None):
        return full(problem.op, TOO_SMALL if small else NOT_INSTALLED.format(CAREFUL))
    if flow is None or small or not (careful or mosaic):
        return judge(problem, quick, until=until)
    careful_flow = flow(first=patience(problem.op) // 2, still=False, renew=4, displace=False, **asdict(TUNED))
    return judge(problem, quick, careful_flow, each_view, until)
