"""How values rise with the light that masks let pass."""

from __future__ import annotations

import numpy as np


def rise(y: np.ndarray, light: np.ndarray) -> tuple[float, float]:
    """The slope of y against light, both (N,) and in units of their means, and its standard error.

    It is 1 for what is seen through the masks, and 0 for what a pixel reads without them.
    """
    if y.size < 3 or np.ptp(light) <= 1e-6 * light.max():  # sums of the same masks differ by rounding
        return 0.0, np.inf
    light, y = light / float(light.mean()) - 1, y / y.mean() - 1
    squares = float(light @ light)
    slope = float(light @ y) / squares
    return slope, float(np.sqrt(np.sum(np.square(y - slope * light)) / ((y.size - 2) * squares)))
