"""Estimation of the noise level from a single measurement, and from what a prediction leaves of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci._validate import require_finite, shaped
from pnp_sci.errors import InputTypeError
from pnp_sci.sensing.operator import SensingOperator

BLOCK = 8  # pixels per side of a block
WIDE = 16  # pixels per side of a block in which only unseen pixels count
QUIET = 6  # such blocks, at least, that decide: fewer may have small errors by chance
FEWEST = 16  # blocks for an estimate


@dataclass(frozen=True)
class NoiseNumbers(Tuned):
    """Parameters of the estimate."""

    quantile: float = 0.02  # quantile of the residual variances of the blocks


TUNED = NoiseNumbers()


def estimate_noise(
    op: SensingOperator, y: Any, saturated: np.ndarray | None = None, bad: np.ndarray | None = None
) -> float:
    """Standard deviation of the noise of a measurement, in the units of y.

    The model of a block of 8 x 8 pixels has a plane and a linear change in time for each view, ``4 V`` coefficients. It
    holds where all views are smooth and move little. The coefficients are fitted by least squares. The residual is
    noise, and texture in most blocks. The estimated variance is the 0.02 quantile of the sums of squared residuals,
    divided by that of the chi-square distribution. This is right if a few blocks are flat. Without noise the estimate
    is the texture of the flattest blocks, about 0.001 to 0.01 of max(y) for natural scenes.

    Parameters
    ----------
    op : SensingOperator
    y : array_like, (H, W)
        Finite real numbers.
    saturated : ndarray of bool, (H, W), optional
        Blocks with a saturated pixel are not used.
    bad : ndarray of bool, (H, W), optional
        Pixels that are not used. Blocks with fewer than twice as many good pixels as coefficients are not used.

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
    views, frames, rows, columns = op.shape
    y = shaped("y", y, (rows, columns), np.dtype(np.float64))
    require_finite("y", y)
    saturated, bad = (
        None if pixels is None else shaped(name, pixels, y.shape, np.dtype(bool))
        for name, pixels in (("saturated", saturated), ("bad", bad))
    )
    good = np.ones((rows // BLOCK) * (columns // BLOCK), int) * BLOCK * BLOCK if bad is None else blocks(~bad).sum(1)
    freedom = good - 4 * views
    usable = freedom >= (1 if bad is None else 4 * views)
    if saturated is not None:
        usable &= ~blocks(saturated).any(1)
    if usable.sum() < FEWEST:
        return 0.0
    right, down = (t.reshape(-1) for t in np.meshgrid(*[np.linspace(-0.5, 0.5, BLOCK)] * 2))
    time = np.linspace(-1, 1, frames) if frames > 1 else np.zeros(1)
    terms = []
    for masks in op.masks:
        total = blocks(masks.sum(0, dtype=np.float64))
        drift = blocks(np.einsum("b,bij->ij", time, masks))  # tensordot would start BLAS threads
        terms += [total, total * down, total * right, drift]
    model = np.stack(terms, axis=-1)
    values = blocks(y)
    if bad is not None:
        model, values = model * ~blocks(bad)[..., None], values * ~blocks(bad)
    normal = model.transpose(0, 2, 1) @ model
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny
    product = np.einsum("kpi,kp->ki", model, values)
    fit = np.linalg.solve(normal + ridge * np.eye(model.shape[-1]), product[..., None])[..., 0]
    left_over = ((values - np.einsum("kpi,ki->kp", model, fit)) ** 2).sum(1)
    return _of_quietest(left_over[usable], freedom[usable], TUNED.quantile)


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
