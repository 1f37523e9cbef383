"""Random measurements of training clips, and how they are solved for training samples."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

import pnp_sci
from pnp_sci.plugins.protocols import Prior
from pnp_sci.training.clips import Clip
from priors.motion.measure import SMALLEST
from priors.train.data import Sampler

SETUPS = {(2, 10): 0.45, (2, 6): 0.13, (2, 14): 0.1, (1, 8): 0.2, (1, 16): 0.12}  # (views, frames): probability
QUIET, NOISE = 0.65, (0.004, 0.1)  # fraction without noise, and range of the others' log-uniform noise, of max(y)
DENSE, DENSITY = 0.75, (0.3, 0.6)  # fraction of masks of density 1/2, and range of the others' uniform density
LONG = 0.2  # fraction of measurements solved from `adjoint` at one sigma for long, where errors of single calls add up
ITERATIONS = 300  # of long solves
SIGMA = 3 / 255, 15 / 255  # range of the log-uniform sigma of long solves
SMALL = 0.5  # side of the crop for long solves, in units of that for others
BEST = 0.2  # fraction of the others with effort="best"


def solved(clips: Sequence[Clip], prior: Prior, crop: int, random: np.random.Generator) -> np.ndarray:
    """Solve one random measurement; return its truth (V, B, H, W), float32, in the units of the network's input."""
    long = random.random() < LONG
    truth, masks, y = _measured(clips, max(int(SMALL * crop), SMALLEST) if long else crop, random)
    if long:
        sigma = float(np.exp(random.uniform(*np.log(SIGMA))))
        how: dict[str, Any] = {"init": "adjoint", "iterations": ITERATIONS, "sigma": sigma}
    else:
        how = {"effort": "best" if random.random() < BEST else "balanced"}
    result = pnp_sci.solve(y, masks, prior, scene="full", tol=0, **how)
    return truth / np.float32(result.settings["unit"][0])


def _measured(clips: Sequence[Clip], crop: int, random: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Truth and masks (V, B, crop, crop) and the measurement of a random scene."""
    views, frames = list(SETUPS)[random.choice(len(SETUPS), p=list(SETUPS.values()))]
    sampler = Sampler(clips, frames=frames, crop=crop, batch=1, seed=0)
    truth = np.stack([sampler.piece(random) for _ in range(views)]).astype(np.float32) / 255
    density = 0.5 if random.random() < DENSE else random.uniform(*DENSITY)
    masks = pnp_sci.moving_masks(truth.shape, density, seed=int(random.integers(2**31)))  # type: ignore[arg-type]
    noise = 0.0 if random.random() < QUIET else float(np.exp(random.uniform(*np.log(NOISE))))
    return truth, masks, pnp_sci.simulate(truth, masks, noise, seed=int(random.integers(2**31)))
