"""How bright each frame of a measurement is lit: lamps flicker, and strobes and gain differ from frame to frame."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import gaussian_filter

from pnp_sci.sensing.operator import DIMMEST, SensingOperator
from pnp_sci.sensing.sample import some_pixels

WIDTH = 8  # pixels: standard deviation of the Gaussian that makes a picture of y
PIXELS = 2**15  # about, at most, that tell how bright frames are
TELLING = 0.1  # of the mean square: what the frames of masks must have of their own to tell how each is lit
PARTS = 4  # parts of the picture along each side, each of which is left out once
CERTAIN = 3.0  # standard errors beyond which frames are lit unequally
LIT = 0.1  # light of a view in units of the mean one, below which y does not tell that of its frames
FAINTEST = 0.05  # light of a frame, at least, in units of the mean of its view


def light_of_frames(op: SensingOperator, y: np.ndarray, used: np.ndarray | None = None) -> np.ndarray:
    """How bright each frame is, (V, B, 1, 1), in units of the mean of its view: 1 where all of a view are alike.

    By least squares y is the sum of the masks times these numbers times a picture, which is y smoothed over the sum of
    the masks smoothed. Parts of a scene that become brighter are not meant, but light that changes everywhere. So each
    sixteenth of the picture is left out once (jackknife): frames of a view are lit unequally if the root mean square of
    their differences is above three standard errors of it. Masks that are much alike, as blurred ones that move slowly,
    do not tell: errors of the masks would count as light.

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
    >>> np.round(light.ravel().astype(float), 1).tolist()
    [1.3, 0.7, 1.3, 0.7]
    """
    views, frames = op.shape[:2]
    used = np.ones(y.shape, bool) if used is None else used
    counted = np.where(used, y, 0.0)
    near, opened = (
        gaussian_filter(a, WIDTH, mode="nearest") for a in (counted, op.masks.sum((0, 1), dtype=np.float64) * used)
    )
    open_pixels = np.abs(opened) > DIMMEST * np.abs(opened).max()
    picture = np.divide(near, opened, out=np.zeros_like(near), where=used & open_pixels)
    rows, columns = some_pixels(y.shape, PIXELS)  # type: ignore[arg-type]
    terms = (op.masks[..., rows, columns] * picture[rows, columns]).reshape(views * frames, *rows.shape)
    missing = counted[rows, columns] - terms.sum(0)
    sums = [
        (np.einsum("fij,gij->fg", part, part), np.einsum("fij,ij->f", part, left))
        for part, left in zip(_parts(terms), _parts(missing))
    ]
    of_parts = [np.stack(each) for each in zip(*sums)]
    normals, products = (np.concatenate([each.sum(0)[None], each.sum(0) - each]) for each in of_parts)
    own = np.linalg.eigvalsh(normals)[:, 0]
    if (own <= TELLING * np.trace(normals, axis1=1, axis2=2) / (views * frames)).any():
        return np.ones((views, frames, 1, 1))
    light = 1 + np.linalg.solve(normals, products[..., None]).reshape(-1, views, frames)
    level = light.mean(2, keepdims=True)
    found, *others = light / np.maximum(level, LIT)
    error = (len(others) - 1) * np.var(others, axis=0)
    unequal = np.square(found - 1).sum(1) > CERTAIN**2 * error.sum(1)
    found = np.where(unequal[:, None] & (level[0] > LIT), np.maximum(found, FAINTEST), 1)
    return (found / found.mean(1, keepdims=True))[..., None, None]


def _parts(pictures: np.ndarray) -> list[np.ndarray]:
    """Parts of pictures (..., H, W)."""
    return [part for row in np.array_split(pictures, PARTS, -2) for part in np.array_split(row, PARTS, -1)]
