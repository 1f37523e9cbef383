"""Estimation of the noise level from a single measurement, and from what a prediction leaves of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.ndimage import binary_opening

from pnp_sci._tuned import Tuned
from pnp_sci._validate import require_finite, shaped
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.light import light_of_frames
from pnp_sci.sensing.operator import SensingOperator

BLOCK = 8  # pixels per side of a block
WIDE = 16  # pixels per side of a block in which only unseen pixels count
QUIET = 6  # such blocks, at least, that decide: fewer may have small errors by chance
FEWEST = 16  # blocks for an estimate
REGION = 5  # pixels a side: sparse masks leave smaller regions unlit, which tell the noise


@dataclass(frozen=True)
class NoiseNumbers(Tuned):
    """Parameters of the estimate."""

    quantile: float = 0.02  # quantile of the residual variances of the blocks


TUNED = NoiseNumbers()


def estimate_noise(
    op: SensingOperator,
    y: Any,
    saturated: np.ndarray | None = None,
    bad: np.ndarray | None = None,
    light: np.ndarray | None = None,
) -> float:
    """Standard deviation of the noise of a measurement, in the units of y.

    The model of a block of 8 x 8 pixels has a plane and a linear change in time for each view, ``4 V`` coefficients. It
    holds where all views are smooth and move little. The coefficients are fitted by least squares. The residual is
    noise, and texture in most blocks. The estimated variance is the 0.02 quantile of the sums of squared residuals,
    divided by that of the chi-square distribution. This is right if a few blocks are flat. Without noise the estimate
    is the texture of the flattest blocks, about 0.001 to 0.01 of max(y) for natural scenes.

    Where frames are lit unequally, it is estimated twice, for frames that are equally bright, and for frames as bright
    as they are found to be; the smaller estimate counts. Unlit regions of 5 x 5 pixels and more are not used: there may
    be no noise.

    Parameters
    ----------
    op : SensingOperator
    y : array_like, (H, W)
        Finite real numbers.
    saturated : ndarray of bool, (H, W), optional
        Blocks with a saturated pixel are not used.
    bad : ndarray of bool, (H, W), optional
        Pixels that are not used. Blocks with fewer than twice as many good pixels as coefficients are not used.
    light : ndarray, (V, B, 1, 1), optional
        How bright each frame is; by default what :func:`pnp_sci.sensing.light.light_of_frames` finds.

    Returns
    -------
    float
        >= 0; 0.0 if there are fewer than 16 blocks, or at least as many coefficients as pixels in a block.

    Raises
    ------
    InputError, InputTypeError
        If `op` is no operator, y is not finite, or an array has another shape than the masks.

    Examples
    --------
    >>> import pnp_sci
    >>> op = SensingOperator(pnp_sci.random_masks((2, 4, 64, 64)))
    >>> y = op.forward(np.full(op.shape, 0.5)) + 0.3 * np.random.default_rng(0).standard_normal((64, 64))
    >>> 0.25 < estimate_noise(op, y) < 0.35
    True
    """
    if not isinstance(op, SensingOperator):
        raise InputTypeError(f"op is {type(op).__name__}: a SensingOperator was expected, as SensingOperator(masks) is")
    views, frames, *picture = op.shape
    y = shaped("y", y, tuple(picture), np.dtype(np.float64))
    require_finite("y", y)
    saturated, bad = (
        np.zeros(y.shape, bool) if pixels is None else shaped(name, pixels, y.shape, np.dtype(bool))
        for name, pixels in (("saturated", saturated), ("bad", bad))
    )
    used = ~_regions(op.unlit) & ~bad
    freedom = blocks(used).sum(1) - 4 * views
    usable = (freedom >= np.where(blocks(used).all(1), 1, 4 * views)) & ~blocks(saturated).any(1)
    if usable.sum() < FEWEST:
        return 0.0
    if light is not None:
        light = shaped("light", light, (views, frames, 1, 1), np.dtype(np.float64))
        require_finite("light", light)
        if light.min() < 0:
            raise InputError(f"light has values down to {light.min():.3g}: values >= 0 were expected")
    else:
        light = light_of_frames(op, y, used & ~saturated)
    lights = [np.ones((views, frames))] + ([] if (light == 1).all() else [light[..., 0, 0]])
    left_over = (_left_over(op, y, used, light)[usable] for light in lights)
    return min(_of_quietest(squares, freedom[usable], TUNED.quantile) for squares in left_over)


def _regions(pixels: np.ndarray) -> np.ndarray:
    """The pixels (H, W) of regions of 5 x 5 and more, which may reach beyond the border."""
    beyond = np.pad(pixels, REGION, mode="edge")
    return binary_opening(beyond, np.ones((REGION, REGION)))[REGION:-REGION, REGION:-REGION].astype(bool)


def _left_over(op: SensingOperator, y: np.ndarray, used: np.ndarray, light: np.ndarray) -> np.ndarray:
    """The sum of squares in each block that the model leaves, with frames as bright as `light` (V, B)."""
    right, down = (t.reshape(-1) for t in np.meshgrid(*[np.linspace(-0.5, 0.5, BLOCK)] * 2))
    time = np.linspace(-1, 1, op.shape[1]) if op.shape[1] > 1 else np.zeros(1)
    terms = []
    for masks, bright in zip(op.masks, light):
        total = blocks(np.einsum("b,bij->ij", bright, masks))  # tensordot would start BLAS threads
        drift = blocks(np.einsum("b,bij->ij", bright * time, masks))
        terms += [total, total * down, total * right, drift]
    counted = blocks(used)
    model, values = np.stack(terms, axis=-1) * counted[..., None], blocks(y) * counted
    normal = model.transpose(0, 2, 1) @ model
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny
    product = np.einsum("kpi,kp->ki", model, values)
    fit = np.linalg.solve(normal + ridge * np.eye(model.shape[-1]), product[..., None])[..., 0]
    return ((values - np.einsum("kpi,ki->kp", model, fit)) ** 2).sum(1)


def noise_of_prediction(residual: np.ndarray, unseen: np.ndarray) -> float:
    """Standard deviation of a residual ``y - Phi x`` (..., H, W) in blocks in which it is small.

    Only pixels count from which x was not estimated, `unseen`, bool like the residual: there it is the noise, plus what
    x lacks. It is the root of a quantile of sums of squares in blocks of 16 x 16 pixels, divided by that of the
    chi-square distribution: the 0.02 quantile, or that of six blocks if they are more. Infinite if fewer than 16 blocks
    have such pixels.

    >>> residual = np.ones((128, 128))
    >>> residual[:, :32] = 0.1 * np.random.default_rng(0).standard_normal((128, 32))
    >>> 0.08 < noise_of_prediction(residual, np.ones((128, 128), bool)) < 0.12
    True
    """

    def sums(pictures: np.ndarray) -> np.ndarray:
        return np.concatenate([blocks(one, WIDE).sum(1) for one in pictures.reshape(-1, *pictures.shape[-2:])])

    squares, count = sums(unseen * residual.astype(np.float64) ** 2), sums(unseen)
    usable = count > 0
    if usable.sum() < FEWEST:
        return np.inf
    return _of_quietest(squares[usable], count[usable], max(TUNED.quantile, QUIET / usable.sum()))


def _of_quietest(squares: np.ndarray, freedom: np.ndarray, quantile: float) -> float:
    """The standard deviation of noise of which the quietest blocks have such sums of squares, with such freedom."""
    from scipy.special import gammaincinv

    quantiles_of_chi_square = 2 * gammaincinv(freedom / 2, quantile)  # scipy.stats takes 0.5 s to import
    return float(np.sqrt(np.quantile(squares / quantiles_of_chi_square, quantile)))


def blocks(picture: np.ndarray, size: int = BLOCK) -> np.ndarray:
    """Blocks (N, size * size) of a picture (H, W), in rows; remaining rows and columns are dropped."""
    rows, columns = (n // size for n in picture.shape)
    cut = picture[: rows * size, : columns * size]
    return cut.reshape(rows, size, columns, size).swapaxes(1, 2).reshape(-1, size * size)
