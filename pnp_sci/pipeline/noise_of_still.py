"""The noise of a scene that stands still: that with which pixels of y that are held back are predicted best."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from functools import cache, partial

import numpy as np

from pnp_sci.pipeline.request import Request
from pnp_sci.pipeline.uncertainty import held_back, without_pixels
from pnp_sci.plugins import registry
from pnp_sci.plugins.protocols import Prior
from pnp_sci.scene.choose import QUICK
from pnp_sci.scene.evidence import contested_tile
from pnp_sci.scene.judge import CHANCE
from pnp_sci.sensing.noise import FEWEST, blocks
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.solvers.iterate import iterate
from pnp_sci.solvers.plan import make_plan

SIDE = 256  # pixels: the brightest part of larger pictures stands for them
SEED = 1  # of the pixels that are held back: not those of `uncertainty`, which a second solve does not have


def noise_of_still(problems: Sequence[Problem], scene: SceneModel, request: Request, until: float) -> Sequence[Problem]:
    """The problems with their estimated noise halved as long as pixels of y are predicted better then.

    The estimate from y takes texture for noise. With one frame per view that costs most, as y says nearly everything
    about so few values: without noise, no prior is needed. A tenth of the pixels of y is held back and predicted from
    the others. Where texture is taken for noise the prediction lacks it, and where noise is taken for texture the
    prediction has it. Half of the noise is believed if it makes the squared errors in blocks of 8 x 8 pixels smaller by
    three standard errors, each relative to the sum of both. When it is known that texture counts as noise, one standard
    error is enough for a half of that. Both total variation and the prior that is asked for must say so: strong priors
    may fall from one limit to another, as they minimise nothing, and total variation smooths texture.

    Parameters
    ----------
    problems : sequence of Problem
        Those of a sequence have the same noise; the one in the middle stands for all.
    scene : SceneModel
        What is modelled. With more than one frame per view, the noise stays as it is.
    request : Request
    until : float
        A moment of ``time.perf_counter`` after which the noise stays as it is.
    """
    middle, tv = problems[len(problems) // 2], registry.installed("priors", QUICK)
    part = replace(middle, op=scene.reduce(middle.op))
    if tv is None or part.op.shape[1] > 1 or not (middle.estimated and middle.noise):
        return problems
    if request.mosaic is None:
        light = np.square(part.y, dtype=np.float64)
        part = part.crop(contested_tile(light, np.ones_like(light), SIDE))
    hidden = held_back(part, SEED)
    if hidden is None:
        return problems
    seen = without_pixels(part, hidden)

    def errors(prior: Prior, noise: float) -> np.ndarray:
        """Sums of squared errors of the prediction, in blocks; TimeoutError after `until`."""
        iterations = make_plan(seen.op, noise, prior, effort="fast").iterations
        for state in iterate(seen.op, seen.y, prior, level(seen.op, seen.y), noise=noise):
            if state.iteration == iterations:
                break
            if time.perf_counter() > until:
                raise TimeoutError
        return blocks(hidden * (part.y - part.op.forward(state.x)).astype(np.float64) ** 2).sum(1)

    predictions = [cache(partial(errors, prior)) for prior in (tv(still=False), request.prior)]
    noise, sure = float(middle.noise), CHANCE
    try:
        while all(fewer(told(noise / 2), told(noise), sure) for told in predictions):
            noise, sure = noise / 2, 1.0
    except TimeoutError:
        pass
    return [replace(problem, noise=noise) for problem in problems]


def fewer(some: np.ndarray, others: np.ndarray, sure: float) -> bool:
    """Whether some squared errors in blocks are smaller than others, by so many standard errors of the mean.

    >>> fewer(np.linspace(1, 2, 40), np.linspace(2, 3, 40), 3), fewer(np.ones(40), np.ones(40), 3)
    (True, False)
    """
    used = some + others > 0
    if used.sum() < FEWEST:
        return False
    gain = (others - some)[used] / (others + some)[used]
    return bool(gain.mean() > sure * gain.std() / np.sqrt(gain.size))
