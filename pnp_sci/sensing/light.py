"""How bright each frame of a measurement is lit: lamps flicker, and strobes and gain differ from frame to frame."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from pnp_sci.sensing.operator import DIMMEST, SensingOperator

WIDTH = 8  # pixels: standard deviation of the Gaussian that makes a picture of y
LATTICE = 2**15  # pixels, at most, that tell how bright frames are
RIDGE = 1e-3  # of the mean square: where masks hardly differ, frames are equally bright
PARTS = 4  # parts of the picture along each side, each of which is left out once
CERTAIN = 3.0  # standard errors beyond which frames are lit unequally


def light_of_frames(op: SensingOperator, y: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
    """How bright each frame is, (V, B, 1, 1), in units of the mean of its view: 1 where all of a view are alike.

    By least squares y is the sum of the masks times these numbers times a picture, which is y smoothed over the sum of
    the masks smoothed. Parts of a scene that become brighter are not meant, but light that changes everywhere. So each
    sixteenth of the picture is left out once (jackknife): frames of a view are lit unequally if the root mean square of
    their differences is above three standard errors of it.

    Parameters
    ----------
    op : SensingOperator
    y : ndarray, (H, W)
    used : ndarray of bool, (H, W), optional
        The pixels that tell it.

    References
    ----------
    B. Efron & C. Stein, "The jackknife estimate of variance", Annals of Statistics 9 (1981).

    Examples
    --------
    >>> import pnp_sci
    >>> masks = pnp_sci.random_masks((1, 4, 64, 64))
    >>> scene = np.random.default_rng(0).random((64, 64)) * np.array([1, 0.5, 1, 0.5])[:, None, None]
    >>> light = light_of_frames(SensingOperator(masks), pnp_sci.simulate(scene[None], masks))
    >>> light.ravel().round(1).tolist()
    [1.3, 0.7, 1.3, 0.7]
    """
    views, frames = op.shape[:2]
    used = np.ones(y.shape, bool) if used is None else used
    counted = np.where(used, y, 0.0)
    near, opened = (
        gaussian_filter(a, WIDTH, mode="nearest") for a in (counted, op.masks.sum((0, 1), dtype=np.float64) * used)
    )
    picture = np.divide(near, opened, out=np.zeros_like(near), where=used & (opened > DIMMEST * np.abs(opened).max()))
    step = int(np.ceil(np.sqrt(y.size / LATTICE)))
    lattice = (slice(step // 2, None, step),) * 2
    terms = (op.masks[(..., *lattice)] * picture[lattice]).reshape(views * frames, *picture[lattice].shape)
    missing = counted[lattice] - terms.sum(0)
    sums = [
        (np.einsum("fij,gij->fg", part, part), np.einsum("fij,ij->f", part, left))
        for part, left in zip(_parts(terms), _parts(missing))
    ]
    normal, product = (np.sum(each, axis=0) for each in zip(*sums))
    light = _solved(normal, product, views)
    others = np.stack([_solved(normal - own, product - target, views) for own, target in sums])
    error = (len(others) - 1) * others.var(0)
    unequal = np.square(light - 1).sum(1) > CERTAIN**2 * error.sum(1)
    return np.maximum(np.where(unequal[:, None], light, 1), DIMMEST)[..., None, None]


def _parts(pictures: np.ndarray) -> list[np.ndarray]:
    """Parts of pictures (..., H, W)."""
    return [part for row in np.array_split(pictures, PARTS, -2) for part in np.array_split(row, PARTS, -1)]


def _solved(normal: np.ndarray, product: np.ndarray, views: int) -> np.ndarray:
    """The light (V, B), in units of the mean of each view."""
    ridge = RIDGE * np.trace(normal) / len(normal) + np.finfo(float).tiny
    light = 1 + np.linalg.solve(normal + ridge * np.eye(len(normal)), product).reshape(views, -1)
    return light / np.maximum(light.mean(1, keepdims=True), DIMMEST)
