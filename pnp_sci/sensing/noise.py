"""How much noise a measurement holds, from the measurement alone."""

from __future__ import annotations

import numpy as np

from pnp_sci.sensing.operator import SensingOperator

BLOCK = 8  # pixels a side
QUANTILE = 0.02  # of blocks: the flattest decide


def estimate_noise(op: SensingOperator, y: np.ndarray, saturated: np.ndarray | None = None) -> float:
    """Standard deviation of the noise of a measurement, in the units of y.

    Where all views are smooth and move little, y is within a small block a plane times each view's sum of masks, plus a
    drift along time. These ``4 V`` coefficients are fitted to every block of 8 x 8 pixels; what is left over is noise,
    and texture on top of it in most blocks. The quantile 0.02 of the left-over variances, divided by that of a
    chi-square law, is noise alone if a few blocks are flat. Without noise the estimate is the texture of the flattest
    blocks, about 0.001 to 0.01 of max(y) for natural scenes.

    Parameters
    ----------
    op : SensingOperator
    y : ndarray, (H, W)
    saturated : ndarray of bool, (H, W), optional
        Blocks with such pixels are left out.

    Returns
    -------
    float
        0.0 where the picture is too small to tell (fewer than 16 blocks) or the masks leave no degree of freedom.

    Examples
    --------
    >>> import pnp_sci
    >>> op = SensingOperator(pnp_sci.random_masks((2, 4, 64, 64)))
    >>> y = op.forward(np.full(op.shape, 0.5)) + 0.3 * np.random.default_rng(0).standard_normal((64, 64))
    >>> 0.25 < estimate_noise(op, y) < 0.35
    True
    """
    from scipy.special import gammaincinv

    views, frames, rows, columns = op.shape
    freedom = BLOCK * BLOCK - 4 * views
    usable = np.ones((rows // BLOCK) * (columns // BLOCK), bool)
    if saturated is not None:
        usable = ~_blocks(saturated).any((1, 2))
    if usable.sum() < 16 or freedom < 1:
        return 0.0
    tilt = np.linspace(-0.5, 0.5, BLOCK)
    time = np.linspace(-1, 1, frames) if frames > 1 else np.zeros(1)
    terms = []
    for masks in op.masks:
        total = _blocks(masks.sum(0, dtype=np.float64))
        drift = _blocks(np.einsum("b,bij->ij", time, masks))  # not tensordot: threads of BLAS would go on spinning
        terms += [total, total * tilt[:, None], total * tilt, drift]
    model = np.stack([t.reshape(-1, BLOCK * BLOCK) for t in terms], axis=-1)
    values = _blocks(y.astype(np.float64)).reshape(-1, BLOCK * BLOCK)
    normal = model.transpose(0, 2, 1) @ model
    ridge = 1e-9 * np.trace(normal, axis1=1, axis2=2)[:, None, None] + np.finfo(float).tiny
    right = np.einsum("kpi,kp->ki", model, values)
    fit = np.linalg.solve(normal + ridge * np.eye(model.shape[-1]), right[..., None])[..., 0]
    left_over = ((values - np.einsum("kpi,ki->kp", model, fit)) ** 2).sum(1)
    quantile_of_chi_square = 2 * gammaincinv(freedom / 2, QUANTILE)  # scipy.stats would take half a second to load
    return float(np.sqrt(np.quantile(left_over[usable], QUANTILE) / quantile_of_chi_square))


def _blocks(picture: np.ndarray) -> np.ndarray:
    """(H, W) as (H // 8 * W // 8, 8, 8) blocks; rows and columns left over are cut off."""
    rows, columns = (n // BLOCK for n in picture.shape)
    cut = picture[: rows * BLOCK, : columns * BLOCK]
    return cut.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2).reshape(-1, BLOCK, BLOCK)
