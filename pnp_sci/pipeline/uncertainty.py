"""How large the errors of a result are, from pixels of y that a second estimate has not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pnp_sci.sensing.problem import Problem, without

HELD_BACK = 0.1  # part of the pixels of y
FEWEST = 100  # pixels that must be held back
WIDTH = 2.0  # pixels: standard deviation of the Gaussian mean around a pixel
LOWEST = 0.1  # part of the held-back pixels in which errors are smallest
SHARED = 0.5  # part of the variance that all frames at a pixel share: docs/results/uncertainty.md


def held_back(problem: Problem, seed: int = 0) -> np.ndarray | None:
    """Pixels of y (H, W) that a second estimate may not see; None if there are too few."""
    usable = problem.usable & (problem.op.gram > 0)
    hidden = usable & (np.random.default_rng(seed).random(problem.y.shape) < HELD_BACK)
    return hidden if hidden.sum() >= FEWEST else None


def uncertainty(problem: Problem, hidden: np.ndarray, x: np.ndarray, second: np.ndarray) -> np.ndarray | None:
    """Root mean square error that is expected of each pixel of x (V, B, H, W), in the problem's units.

    A tenth of the pixels of y is held back, and the video is estimated again from the others. Errors are large where
    the two videos differ and where x changes in space or time: with d and g, means around a pixel of the squared
    difference and of the squared gradient, the variance is in proportion to ``sqrt(d g)``. The
    frames of a pixel come from one equation: half of the variance is common to them. What the second video
    predicts of the held-back pixels has errors of the variance ``sum(masks^2 variance)`` beyond the noise, which
    determines the factor.

    Parameters
    ----------
    problem : Problem
    hidden : ndarray of bool, (H, W)
        The pixels that are held back.
    x : ndarray, (V, B, H, W)
    second : ndarray, (V, B, H, W)
        Made as x was made, from the problem without the hidden pixels.

    Returns
    -------
    ndarray, (V, B, H, W), or None
        None if an estimate is not finite.
    """
    op, y = problem.op, problem.y
    if not (np.isfinite(second).all() and np.isfinite(x).all()):
        return None
    pattern = np.sqrt(_around((x - second) ** 2) * _around(_gradient(x)))
    pattern += SHARED * (pattern.mean((0, 1)) - pattern)
    squares = (y - op.forward(second))[hidden].astype(np.float64) ** 2
    noise = np.broadcast_to(np.square(problem.noise, dtype=np.float64), y.shape)[hidden]
    shown = np.einsum("vbp,vbp->p", op.masks[..., hidden].astype(np.float64) ** 2, pattern[..., hidden])
    return np.sqrt(_slope(squares, shown, float(noise.mean())) * pattern).astype(x.dtype)


def _slope(squares: np.ndarray, shown: np.ndarray, noise: float) -> float:
    """The k of the line ``k shown + n`` through squared errors; n is the variance of the noise, or less.

    Texture counts as noise in part. What is left of n where the video has the smallest errors bounds it: a line through
    the means of all pixels and of a tenth of them.
    """
    if not shown.any():
        return 0.0
    low = shown <= np.quantile(shown, LOWEST)
    run = shown.mean() - shown[low].mean()
    rise = squares.mean() - squares[low].mean()
    intercept = squares.mean() - rise / run * shown.mean() if run > 0 else noise
    return float((squares.mean() - np.clip(intercept, 0, noise)) / shown.mean())


def without_pixels(problem: Problem, hidden: np.ndarray) -> Problem:
    """The problem as it is without the pixels that are hidden (H, W)."""
    return replace(problem, op=without(problem.op, hidden), y=problem.y * ~hidden)


def _around(values: np.ndarray) -> np.ndarray:
    from scipy.ndimage import gaussian_filter

    return gaussian_filter(values.astype(np.float64), (0, 0, WIDTH, WIDTH), mode="nearest")


def _gradient(x: np.ndarray) -> np.ndarray:
    """Squared differences to the next frame, row and column."""
    axes = [axis for axis in (1, 2, 3) if x.shape[axis] > 1]
    return np.sum([np.gradient(x, axis=axis) ** 2 for axis in axes], axis=0) if axes else np.ones_like(x)
