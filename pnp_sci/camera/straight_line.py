"""Weighted least squares, and the straight line."""

from __future__ import annotations

import numpy as np


def straight_line(x: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The line of y (K,) against x: its value at 0 and its slope, and their covariance (2, 2)."""
    return least_squares(np.stack([np.ones_like(x), x], -1), y, weight)


def least_squares(design: np.ndarray, y: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of a weighted least-squares fit and their covariance, robust against wrong weights and few blocks.

    The covariance is HC3 of MacKinnon & White (1985): each residual is divided by one less its leverage.
    """
    inverse = np.linalg.pinv(design.T @ (design * weight[:, None]))
    coefficients = inverse @ (design.T @ (weight * y))
    leverage = weight * np.einsum("ki,ij,kj->k", design, inverse, design)
    residual = (y - design @ coefficients) / np.maximum(1 - leverage, np.finfo(float).eps)
    scores = design * (weight * residual)[:, None]
    return coefficients, inverse @ (scores.T @ scores) @ inverse
