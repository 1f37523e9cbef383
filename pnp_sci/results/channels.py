"""Colours as channels, for formats that have no axis of colours."""

from __future__ import annotations

import numpy as np


def as_channels(x: np.ndarray) -> np.ndarray:
    """Colour videos (..., V, B, H, W, 3) as (..., 3 V, B, H, W): red, green and blue of each view.

    >>> as_channels(np.ones((2, 4, 8, 8, 3))).shape
    (6, 4, 8, 8)
    """
    *several, views, frames, rows, columns, _ = x.shape
    return np.moveaxis(x, -1, -4).reshape(*several, 3 * views, frames, rows, columns)


def in_colour(x: np.ndarray) -> np.ndarray:
    """The inverse of :func:`as_channels`."""
    *several, channels, frames, rows, columns = x.shape
    return np.moveaxis(x.reshape(*several, channels // 3, 3, frames, rows, columns), -4, -1)
