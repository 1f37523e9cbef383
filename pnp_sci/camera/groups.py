"""Hot pixels that touch each other: columns, rows and blocks, in which they hide each other from their neighbours."""

from __future__ import annotations

import numpy as np

from pnp_sci.camera.rise import rise
from pnp_sci.camera.verdict import HALF, LIKELY

BRIGHT = 0.95  # quantile of y: a group is brighter than most of the picture
SHARP = 1.5  # ratio of the darkest pixel of a group to the brightest around it
TOP, EQUAL = 0.75, 0.005  # quantile, and how near to the largest value it must not be, as part of the mean
SOLID = 0.9  # part of its rectangle that a group fills; what moves behind masks fills about their density
FEWEST = 9  # pixels: fewer do not tell whether they follow the masks


def hot_groups(y: np.ndarray, masks: np.ndarray, usable: np.ndarray) -> np.ndarray:
    """Pixels of hot groups of y (H, W), bool, for masks (V, B, H, W) >= 0; `usable` pixels are compared.

    A group has sharp sides: all its pixels are much brighter than those around it. And unlike a bright spot of the
    scene it does not follow the masks: y varies, but neither as a view's sum of masks nor as any one mask, by which a
    flash of light is seen.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> y = scene.y.copy()
    >>> y[:, 20:22] = y.max() * np.random.default_rng(0).uniform(3, 4, (64, 2))
    >>> hot = hot_groups(y, scene.masks, np.ones(y.shape, bool))
    >>> int(hot.sum()), int(hot[:, 20:22].sum())
    (128, 128)
    """
    from scipy.ndimage import find_objects, label, maximum, maximum_filter, minimum

    hot = np.zeros(y.shape, bool)
    level = np.quantile(y[usable], BRIGHT) if usable.any() else 0.0
    bright = usable & (y > SHARP * level) & (level > 0)
    if bright.sum() < FEWEST:
        return hot
    labels = np.asarray(label(bright, np.ones((3, 3)))[0])  # type: ignore[index]
    numbers = np.arange(1, labels.max() + 1)
    around = maximum_filter(np.where(bright, 0, y), 5)
    sharp = minimum(y, labels, numbers) > SHARP * maximum(around, labels, numbers)
    counts, boxes = np.bincount(labels.flat)[1:], find_objects(labels)
    solid = counts >= SOLID * np.array([labels[box].size for box in boxes])
    for number in numbers[sharp & solid & (counts >= FEWEST)]:
        group = labels == number
        frames = masks[:, :, group].astype(np.float32)
        lights = (frames.sum((0, 1)), *frames.sum(1), *frames.reshape(-1, frames.shape[-1]))
        hot |= group & all(_ignores(y[group], light) for light in lights if light.any())
    return hot


def _ignores(y: np.ndarray, light: np.ndarray) -> bool:
    """Whether y rises less than the light that masks let pass, both (N,), in units of their means."""
    y = y / y.mean()
    if np.quantile(y, TOP) > y.max() - EQUAL or np.sum(y == y.max()) > 2:  # equal values may be saturated
        return False
    slope, error = rise(y, light)
    return slope + LIKELY * error < HALF
