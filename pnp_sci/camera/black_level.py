"""The black level of a measurement: what it has beyond the light that its fine detail tells of."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.explained import BLOCK
from pnp_sci.camera.local_model import LocalFit, LocalModel
from pnp_sci.camera.straight_line import least_squares, straight_line
from pnp_sci.sensing.noise import blocks

FLOOR = 0.01  # of the median variance of the blocks: none counts as exact
CHANCE = 3.0  # standard errors within which a slope counts as 1, and a level as 0


def black_level(model: LocalModel, fit: LocalFit) -> tuple[float, float]:
    """The constant that measurements have beyond what the fit explains, and its standard error.

    The levels of the views come from fine detail, which no constant reaches. So does the light of a block, that of the
    levels times the masks. It is a straight line of the mean of y there; the black level is where the line meets 0. The
    slope is 1 if the masks have the right contrast. If it is not, within three standard errors, it is fitted too.

    Stray light in a part of the picture tilts the line, so that it meets 0 far away. So the level must be more than
    three standard errors, and y less the level must be closer to the light than y is. If not, it is 0. The error is
    infinite where y less the level is no closer, and where masks complement each other and do not tell the light.
    """
    if not model.tells_light:
        return 0.0, float("inf")
    mean, light, weight = _blocks(model.measurements, fit)
    if mean.shape[1] < 3:
        return 0.0, float("inf")
    level, error = _where_no_light_is(mean, light, weight)
    if abs(level) <= CHANCE * error:
        return 0.0, error
    before, after = (float(np.sum(weight * (light - y) ** 2)) for y in (mean, mean - level))
    return (level, error) if after < before else (0.0, float("inf"))


def _where_no_light_is(mean: np.ndarray, light: np.ndarray, weight: np.ndarray) -> tuple[float, float]:
    """Where the line of the light against the mean meets 0, and its standard error."""
    (start, slope), errors = straight_line(mean, light, weight)
    if abs(slope - 1) > CHANCE * float(np.sqrt(errors[1, 1])) and slope > 0:
        along = np.array([-1 / slope, start / slope**2])  # of -start / slope
        return float(-start / slope), float(np.sqrt(along @ errors @ along))
    level, error = least_squares(np.ones((*mean.shape, 1)), mean - light, weight)
    return float(level[0]), float(np.sqrt(error[0, 0]))


def light_against_mean(model: LocalModel, fit: LocalFit) -> float:
    """The slope of the straight line of the light of blocks against the mean of y there.

    It is 1 if the masks have the right contrast, below 1 if they have too much.
    """
    (_, slope), _ = straight_line(*_blocks(model.measurements, fit))
    return float(slope)


def _blocks(measurements: np.ndarray, fit: LocalFit) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each measurement and block: the mean of y, the light that the fit tells of, and the weight of that, (N, K)."""
    coefficients = fit.design.shape[-1]
    there = fit.usable.sum(1) > coefficients
    usable = fit.usable[there]
    pixels = usable.sum(1)
    columns = fit.columns.reshape(-1, *measurements.shape[1:])
    means = np.stack([(blocks(c, BLOCK)[there] * usable).sum(1) for c in columns], -1) / pixels[:, None]  # (K, Q)
    mean = np.stack([(blocks(y, BLOCK)[there] * usable).sum(1) / pixels for y in measurements])
    light = np.einsum("kq,nkq->nk", means, fit.levels[:, there])
    spread = (fit.residual[:, there] ** 2).sum(-1) / (pixels - coefficients)
    variance = spread * np.einsum("kq,kqr,kr->k", means, fit.inverse[there], means)
    weight = 1 / (variance + FLOOR * np.median(variance) + np.finfo(float).tiny)
    return mean, light, weight
