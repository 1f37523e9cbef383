"""Colours as channels, for formats that have no axis of colours."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

COLOURS = "RGB"  # the order of the channels of a view


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


def names(channels: int, colour: bool) -> list[str]:
    """What channels are called: a view each, or with `colour` three of them.

    >>> names(2, False), names(3, True)
    (['view 1', 'view 2'], ['view 1 R', 'view 1 G', 'view 1 B'])
    """
    if not colour:
        return [f"view {view + 1}" for view in range(channels)]
    return [f"view {view + 1} {c}" for view in range(channels // len(COLOURS)) for c in COLOURS]


def are_views(named: Sequence[str]) -> bool:
    """Whether :func:`names` calls views, or their colours, so.

    >>> are_views(["view 1", "view 2"]), are_views(["DAPI", "GFP"])
    (True, False)
    """
    return are_colours(named) or (bool(named) and list(named) == names(len(named), False))


def are_colours(named: Sequence[str]) -> bool:
    """Whether :func:`names` calls the colours of views so.

    >>> are_colours(["view 1 R", "view 1 G", "view 1 B"]), are_colours(["view 1", "view 2", "view 3"])
    (True, False)
    """
    return bool(named) and list(named) == names(len(named), True)
