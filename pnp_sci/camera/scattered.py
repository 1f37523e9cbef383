"""Scattered hot pixels, too many for the tail that `outliers` extrapolates."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.outliers import FEW, LEAST, PASSES, UNLIKELY, expected, most_unlike, tail_size, typical_step
from pnp_sci.camera.pile import NEAR
from pnp_sci.camera.rise import rise
from pnp_sci.camera.verdict import HALF, SURELY

TWICE = 2.0  # ratio to neighbours within two pixels, more for others


def scattered_hot(y: np.ndarray, weight: np.ndarray, masks: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Many scattered hot pixels of y (H, W), bool, for masks (V, B, H, W) >= 0 of the sum `weight`; none if few.

    Each is twice as bright as its masks and all but one of its neighbours allow, or 1.5 times and as bright as most
    that are, and at least half of them are at the camera's ceiling. Light is kept: it rises with the weight, its masks
    are open more often, or its pixels touch.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> hot = np.random.default_rng(0).random((64, 64)) < 0.05
    >>> y = np.where(hot, 3 * scene.y.max(), scene.y)
    >>> found = scattered_hot(y, scene.masks.sum((0, 1)).astype(float), scene.masks, np.ones(y.shape, bool))
    >>> bool(found[hot].mean() > 0.95), int(found[~hot].sum())
    (True, 0)
    """
    hot, none = np.zeros(y.shape, bool), np.zeros(y.shape, bool)
    most = int(FEW * usable.sum())
    if most < 1 or np.median(y[usable]) <= 0:  # single photons are scattered, too
        return none
    for _ in range(PASSES):  # what is found no longer hides others
        left = usable & ~hot
        as_bright = left & (y >= (np.median(y[hot]) if hot.any() else np.inf))
        rows, columns, ratio, reach = most_unlike(y, weight, left, most, beside=left & ~as_bright)
        chosen = ratio > np.where(as_bright[rows, columns], LEAST, TWICE) * reach / 2
        hot[rows[chosen], columns[chosen]] = True
        if not HALF * tail_size(y.size) < hot.sum() < most:
            return none
        if not chosen.any():
            break
    if np.mean(y[hot] >= (1 - NEAR) * y[hot].max()) < HALF:  # flashes differ in brightness
        return none
    excess = (y - expected(y, weight, usable & ~hot))[hot]
    of_noise = np.median(excess) < UNLIKELY * typical_step(y, usable & ~hot)
    slope, error = rise(excess, weight[hot])
    of_light = slope + error > HALF or _touch(hot, usable) or _follow(masks, weight, hot, usable)
    return none if of_noise or of_light else hot


def _touch(hot: np.ndarray, usable: np.ndarray) -> bool:
    """Whether more of the hot pixels are side by side than by chance, as those of light are."""
    pairs = np.sum(hot[1:] & hot[:-1]) + np.sum(hot[:, 1:] & hot[:, :-1])
    by_chance = 2 * hot.sum() ** 2 / usable.sum()
    return bool(pairs > by_chance + SURELY * np.sqrt(by_chance))


def _follow(masks: np.ndarray, weight: np.ndarray, hot: np.ndarray, usable: np.ndarray) -> bool:
    """Whether the hot pixels let more light pass than others, in a frame or in all, beyond chance."""
    for light in (weight, *masks.reshape(-1, *hot.shape)):
        others = light[usable]
        if light[hot].mean() > others.mean() + SURELY * others.std(dtype=np.float64) / np.sqrt(hot.sum()):
            return True
    return False
