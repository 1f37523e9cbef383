"""The unit of a scene whose brightest parts are small or pass quickly."""

from __future__ import annotations

import time
from collections.abc import Sequence

import numpy as np

from pnp_sci.plugins import registry
from pnp_sci.scene.choose import QUICK
from pnp_sci.sensing.problem import TUNED as UNIT
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.solvers.iterate import iterate

ROUNDS = 3  # quick estimates at most, each in the unit that the one before has found
ITERATIONS = 10  # of a quick estimate
SIGMA = 0.4  # of its total variation: large, so that small things become bright within few iterations
USUAL = 1.1  # what quick estimates of natural scenes span, few of them up to 1.35


def in_unit_of_scene(problems: Sequence[Problem], until: float = np.inf) -> list[Problem]:
    """Problems of consecutive measurements, in a common unit that is large enough for the one in the middle.

    Where the brightest parts of a scene are small, or are there in few frames only, such as particles in the dark, the
    mean that y shows tells little of their brightness. In a unit that is too small a solver raises them slowly, and a
    network sees values that it was not trained for. A quick estimate by total variation shows more of them. It does so
    the better, the better its unit, so it is made again as long as it spans more than natural scenes do. An
    estimate that is not done at the moment `until` of ``time.perf_counter`` does not count.
    """
    from scipy.ndimage import minimum_filter

    tv, problems = registry.installed("priors", QUICK), list(problems)
    for _ in range(ROUNDS if tv else 0):
        x = _quick(problems[len(problems) // 2], tv(still=False), until)  # type: ignore[misc]
        if x is None:
            break
        # single pixels do not count, as they may be bad ones
        spanned = float(np.quantile(minimum_filter(x, (1, 1, 2, 2), mode="nearest"), 1 - UNIT.brighter)) / USUAL
        if not 1 < spanned < np.inf:
            break
        problems = [problem.scaled(spanned) for problem in problems]
    return problems


def _quick(problem: Problem, prior: object, until: float) -> np.ndarray | None:
    """A quick estimate (V, B, H, W); None if it is not done at the moment `until`."""
    op, y = problem.op, problem.y
    for state in iterate(op, y, prior, level(op, y), noise=problem.noise, sigma=SIGMA, saturated=problem.saturated):
        if time.perf_counter() > until:
            break
        if state.iteration == ITERATIONS:
            return state.x
    return None
