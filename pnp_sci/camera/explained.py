"""How much of a measurement's fine detail follows the masks."""

from __future__ import annotations

import numpy as np

from pnp_sci.sensing.noise import blocks

WIDTH = 2.0  # pixels: standard deviation of the Gaussian mean that is not fine detail
BLOCK = 16  # pixels a side of a block, in which a view's level is one number


def fine_detail(picture: np.ndarray) -> np.ndarray:
    """A picture (H, W) less its Gaussian mean."""
    from scipy.ndimage import gaussian_filter

    picture = np.asarray(picture, np.float64)
    return picture - gaussian_filter(picture, WIDTH, mode="nearest")


def explained_share(sums: np.ndarray, y: np.ndarray) -> float:
    """Share of the variance of the fine detail of y (H, W) that the sums (V, H, W) of the views' masks explain.

    In blocks of 16 x 16 pixels, y is regressed on the sums; the coefficients are the views' levels. The sums vary from
    pixel to pixel by the coding pattern only, which no scene follows. The share is adjusted for the number of
    coefficients: its expectation is 0 for masks that have nothing to do with y.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> sums = scene.masks.sum(1, dtype=float)
    >>> explained_share(sums, scene.y) > 0.7, abs(explained_share(sums[:, ::-1], scene.y)) < 0.05
    (True, True)
    """
    columns = np.stack([blocks(fine_detail(total), BLOCK) for total in sums], -1)  # (blocks, pixels, V)
    detail = blocks(fine_detail(y), BLOCK)
    total = float((detail**2).sum())
    if total == 0:
        return 0.0
    normal = columns.transpose(0, 2, 1) @ columns
    right = np.einsum("kpv,kp->kv", columns, detail)
    coefficients = np.einsum("kvw,kw->kv", np.linalg.pinv(normal, rcond=1e-6, hermitian=True), right)
    share = float((right * coefficients).sum()) / total
    freedom = BLOCK * BLOCK - len(sums)
    return share - (1 - share) * len(sums) / freedom
