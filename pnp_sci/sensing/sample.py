"""Pixels that stand for all of a picture."""

from __future__ import annotations

import numpy as np


def some_pixels(shape: tuple[int, int], most: int) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (h, w) of about `most` pixels of a picture of this shape, or of all if they are no more.

    One of each square cell, at random: masks may be periodic, as a regular grid is. The choice is always the same.

    >>> rows, columns = some_pixels((64, 64), 256)
    >>> rows.shape, int(rows[1].min()) >= 4, int(rows[1].max()) < 8
    ((16, 16), True, True)
    """
    step = int(np.ceil(np.sqrt(shape[0] * shape[1] / most)))
    cells, random = [max(n // step, 1) for n in shape], np.random.default_rng(0)
    corners = np.meshgrid(*(step * np.arange(count) for count in cells), indexing="ij")
    rows, columns = (corner + random.integers(min(step, n), size=cells) for corner, n in zip(corners, shape))
    return rows, columns
