"""Whether the frames of the masks are in the order of time."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from pnp_sci.plugins import registry
from pnp_sci.sensing.noise import blocks
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import level, pose
from pnp_sci.sensing.sensor import Sensor
from pnp_sci.solvers.iterate import iterate

PRIOR, ITERATIONS = "tv", 40
MEASUREMENTS = 4  # of a sequence, at most
SURELY = 5.0  # standard errors
BLOCK = 8  # pixels a side, over which differences are summed


def frame_order(op: SensingOperator, measurements: np.ndarray, sensor: Sensor) -> str:
    """Whether successive measurements (N, H, W) follow each other "forward" or "reversed", or "unknown".

    The last frame of a measurement resembles the first one of the next. With reversed masks every film runs backwards,
    and its first frame resembles the last one of the next. A single measurement cannot tell: masks in reversed order
    explain it as well as the right ones, by the reversed film.
    """
    if len(measurements) < 2 or op.shape[1] < 2:
        return "unknown"
    videos = [_estimate(op, y, sensor) for y in measurements[:MEASUREMENTS]]
    pairs = itertools.pairwise(videos)
    gains = np.concatenate([_apart(a[:, 0], b[:, -1]) - _apart(a[:, -1], b[:, 0]) for a, b in pairs])
    error = float(np.sqrt(np.sum(np.square(gains - gains.mean()))))
    if abs(gains.sum()) <= SURELY * error:
        return "unknown"
    return "forward" if gains.sum() > 0 else "reversed"


def _estimate(op: SensingOperator, y: np.ndarray, sensor: Sensor) -> np.ndarray:
    """A quick estimate (V, B, H, W) of the film, where white is about 1."""
    problem = pose(op, 1.0, y, sensor)
    prior: Any = registry.installed("priors", PRIOR)
    states = iterate(op, problem.y, prior(still=False), level(op, problem.y), noise=problem.noise)
    return next(itertools.islice(states, ITERATIONS, None)).x


def _apart(frames: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Squared differences of two frames (V, H, W), summed over the views and in blocks, (K,)."""
    return blocks(np.square(frames - others).sum(0), min(BLOCK, *frames.shape[1:])).sum(1)
