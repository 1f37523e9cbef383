"""Values at which a measurement piles up: a camera that is saturated, below the full scale that was stated."""

from __future__ import annotations

import numpy as np

CLIPPED, FEW = 1e-3, 16  # smallest fraction and number of pixels that are a pile
WIDTHS = (0.0, *np.geomspace(2.0**-12, 0.05, 9))  # of the largest value: dark frames that differ widen a pile
NEAR = 0.02  # of the largest value: what is compared with the pixels that have exactly that value


def pile(y: np.ndarray, weight: np.ndarray) -> tuple[float, float] | None:
    """The lowest and the highest value of a pile at the upper end of y (any shape), or None.

    The values of a scene become rarer towards the largest one. A pile is an interval at the upper end with at least
    0.1 % of the pixels and more than twice as many as the interval of the same width below it. The `weight` of its
    pixels, the sum of the masks' magnitudes, must differ: a white part of a scene has one value where the weight is
    the same.

    Examples
    --------
    >>> rng = np.random.default_rng(0)
    >>> light, dark = rng.gamma(4, 250, (64, 64)), rng.normal(60, 3, (64, 64))
    >>> low, high = pile(np.minimum(light + dark, 2000) - dark, rng.random((64, 64)))
    >>> 1915 < low < high < 1960
    True
    """
    values = np.sort(y, None)
    top, count = float(values[-1]) if values.size else 0.0, values.size
    best, found = 0.0, None  # a wider interval is taken if it holds a tenth more
    for width in WIDTHS if top > 0 else ():
        low, lower = top * (1 - float(width)), top * (1 - (2 * width or NEAR))
        inside = count - int(np.searchsorted(values, low))
        below = count - inside - int(np.searchsorted(values, lower))
        many = max(CLIPPED * count, FEW) <= inside < count / 2
        score = inside - 2 * below * (width > 0)
        if many and 2 * below < inside and score > 1.1 * best and _varies(weight[y >= low], width):
            best, found = score, (low, top)
    return found


def _varies(weight: np.ndarray, width: float) -> bool:
    """Whether most pixels have another weight than their median, beyond the width of the pile."""
    typical = np.median(weight)
    return bool(np.mean(np.abs(weight - typical) > (width + 1e-3) * typical) > 0.5)
