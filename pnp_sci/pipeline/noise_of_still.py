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

HALVINGS = 6  # at most
SIDE = 256  # pixels: the brightest part of larger pictures stands for them
SEED = 1  # of the pixels that are held back: not those of `uncertainty`, which a second solve does not have


def noise_of_still(problems: Sequence[Problem], scene: SceneModel, request: Request, until: float) -> Sequence[Problem]:
    """The problems with their estimated noise halved as long as pixels of y are predicted better then.

    The estimate from y takes texture for noise. With one frame per view that costs most, as y says nearly everything
    about so few values: without noise, no prior is needed. A tenth of the pixels of y is held back and predicted from
    the others. Where texture is taken for noise the prediction lacks it, and where noise is taken for texture the
    prediction has it. Half of the noise is believed if total variation predicts better with it by three standard
    errors, and the prior that is asked for better at all. What counts is the mean over blocks of 8 x 8 pixels of
    the differences of the squared errors, each relative to the sum of both. Strong priors alone do not tell: they
    minimise nothing, so that a little less noise may bring them to a limit far away.

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
    start = level(seen.op, seen.y)

    def errors(prior: Prior, noise: float) -> np.ndarray:
        """Sums of squared errors of the prediction, in blocks; TimeoutError after `until`."""
        iterations = make_plan(seen.op, noise, prior, effort="fast").iterations
        for state in iterate(seen.op, seen.y, prior, start, noise=noise, saturated=seen.saturated):
            if state.iteration == iterations:
                break
            if time.perf_counter() > until:
                raise TimeoutError
        return blocks(hidden * (part.y - part.op.forward(state.x)).astype(np.float64) ** 2).sum(1)

    by_tv, by_prior = (cache(partial(errors, prior)) for prior in (tv(still=False), request.prior))
    noise = float(middle.noise)
    try:
        for _ in range(HALVINGS):
            if gain(by_tv(noise / 2), by_tv(noise)) <= CHANCE or gain(by_prior(noise / 2), by_prior(noise)) <= 0:
                break
            noise /= 2
    except TimeoutError:
        pass
    return [replace(problem, noise=noise, estimated=False) for problem in problems]


def gain(some: np.ndarray, others: np.ndarray) -> float:
    """By how many standard errors some squared errors in blocks are smaller than others.

    >>> gain(np.ones(40), np.ones(40)), gain(np.linspace(1, 2, 40), np.linspace(2, 3, 40)) > 3
    (0.0, True)
    """
    used = some + others > 0
    if used.sum() < FEWEST:
        return 0.0
    gains = (others - some)[used] / (others + some)[used]
    return float(gains.mean() / max(gains.std() / np.sqrt(gains.size), np.finfo(float).tiny))
