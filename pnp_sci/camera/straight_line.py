"""Weighted least squares, and the straight line."""

from __future__ import annotations

import numpy as np


def straight_line(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The line of y (..., K) against x: its value at 0 and its slope, and their covariance (2, 2)."""
    return least_squares(np.stack([np.ones_like(x), x], -1), y, weight)


def least_squares(design: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of a weighted least-squares fit and their covariance, robust against wrong weights and few blocks.

    `design` is (..., K, P), `y` and `weight` (..., K) of K independent blocks: values of one block, such as those of
    several measurements, may depend on each other. The covariance is CR3 of Bell & McCaffrey (2002): the residuals of
    a block are multiplied by the inverse of ``1 - leverage``. With one value a block it is HC3 of MacKinnon & White
    (1985).
    """
    blocks = design.shape[-2]
    root = np.sqrt(weight).reshape(-1, blocks).T  # (K, N)
    rows = np.moveaxis(design.reshape(-1, *design.shape[-2:]), 1, 0) * root[..., None]  # (K, N, P)
    values = y.reshape(-1, blocks).T * root
    inverse = np.linalg.pinv(np.einsum("kni,knj->ij", rows, rows))
    coefficients = inverse @ np.einsum("kni,kn->i", rows, values)
    residual = values - rows @ coefficients
    away = np.eye(rows.shape[1]) - rows @ inverse @ rows.transpose(0, 2, 1)  # 1 - leverage, (K, N, N)
    alone = (np.linalg.pinv(away, hermitian=True) @ residual[..., None])[..., 0]
    scores = np.einsum("kni,kn->ki", rows, alone)
    return coefficients, inverse @ (scores.T @ scores) @ inverse
