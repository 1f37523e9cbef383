"""Pixels that a quick estimate of the scene does not explain: faint hot ones that stand out from no neighbours."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from pnp_sci.camera.outliers import beyond_tail, tail_size
from pnp_sci.plugins import registry
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.solvers.iterate import iterate

PRIOR, ITERATIONS = "tv", 25
BY_CHANCE = 1e-4  # of the good pixels that are taken for outliers beside others: they are not missed
MANY = 5.0  # times as many as by chance: fewer are no evidence of any outlier
WIDTH = 4.0  # pixels: standard deviation of the Gaussian mean that estimates the local spread of residuals
CLIPPED = 3.0  # spreads: what is beyond counts as that much in the local spread


def unexplained(problem: Problem) -> np.ndarray:
    """Pixels whose residual is far larger than those around, bool (H, W).

    A smooth film cannot follow what a single pixel reads. Its residual ``y - Phi x``, in units of the local spread, has
    an exponential tail, as in :func:`pnp_sci.camera.outliers.outliers`. What lies beyond is left out if it is more than
    what good pixels leave there.
    """
    known = problem.usable & (problem.op.gram > 0)
    prior: Any = registry.installed("priors", PRIOR)
    if prior is None or known.sum() < 4 * tail_size(known.size):
        return np.zeros(known.shape, bool)
    start, op = level(problem.op, problem.y), problem.op
    states = iterate(op, problem.y, prior(still=False), start, algorithm="plain-gap", noise=problem.noise)
    state = next(itertools.islice(states, ITERATIONS, None))
    residual = (problem.y - op.forward(state.x)) * known
    size = np.abs(residual) / _spread(residual, known)
    by_chance = BY_CHANCE * known.sum()
    found = known & (size > beyond_tail(size[known], tail_size(known.size), by_chance))
    return found & (found.sum() > MANY * by_chance)


def _spread(residual: np.ndarray, known: np.ndarray) -> np.ndarray:
    """Local root mean square of the residual (H, W); single large values are clipped."""
    from scipy.ndimage import gaussian_filter

    weight = np.maximum(gaussian_filter(known.astype(residual.dtype), WIDTH, mode="nearest"), 1e-6)
    clipped = residual
    for _ in range(3):
        spread = np.sqrt(gaussian_filter(clipped**2, WIDTH, mode="nearest") / weight)
        spread = np.maximum(spread, 1e-3 * np.median(spread) + np.finfo(residual.dtype).tiny)
        clipped = np.clip(residual, -CLIPPED * spread, CLIPPED * spread)
    return spread
