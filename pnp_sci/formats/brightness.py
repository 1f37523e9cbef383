"""What is shown as white: one value, or one for each view."""

from __future__ import annotations

from typing import Any

import numpy as np

from pnp_sci._validate import shown
from pnp_sci.errors import InputError

PERCENTILE = 99.9  # a few overshooting pixels do not darken the picture


def brightest(x: np.ndarray) -> float:
    """The 99.9th percentile of x; 1 where that is not positive.

    >>> brightest(np.full((2, 3), 0.5))
    0.5
    """
    value = float(np.percentile(x, PERCENTILE))
    return value if value > 0 else 1.0


def of_views(levels: np.ndarray, video: np.ndarray) -> np.ndarray:
    """White of each view (V,), as it goes with the axes of a video (V, B, H, W) or (V, B, H, W, 3)."""
    return levels.reshape(-1, *[1] * (video.ndim - 1))


def whites(white: Any, x: np.ndarray, default: float | None = None) -> np.ndarray:
    """White of each view, (V,), for videos x of shape (N, V, B, H, W) or (N, V, B, H, W, 3).

    Parameters
    ----------
    white : None, float, sequence of V floats, or "view"
        "view": the 99.9th percentile of each view. None: `default`, or that percentile of all.

    Raises
    ------
    InputError
        If it is none of these, or a value is not > 0.

    Examples
    --------
    >>> whites("view", np.array([1.0, 0.2]).reshape(1, 2, 1, 1, 1)).tolist()
    [1.0, 0.2]
    """
    views = x.shape[1]
    if isinstance(white, str) and white == "view":
        return np.array([brightest(x[:, view]) for view in range(views)])
    if white is None:
        white = brightest(x) if default is None else default
    try:
        levels = np.array(white, np.float64)
    except (TypeError, ValueError):
        levels = np.array(np.nan)
    if levels.shape not in ((), (1,), (views,)) or not (np.isfinite(levels) & (levels > 0)).all():
        raise InputError(f'white is {shown(white)}: a number > 0, {views} of them (one a view), or "view" was expected')
    return np.broadcast_to(levels, views).copy()
