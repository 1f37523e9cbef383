"""The fine detail of pictures."""

from __future__ import annotations

import numpy as np

WIDTH = 2.0  # pixels: standard deviation of the Gaussian mean that is not fine detail
BLOCK = 16  # pixels a side of a block, in which a view's level is one number


def fine_detail(picture: np.ndarray) -> np.ndarray:
    """A picture (H, W) less its Gaussian mean."""
    from scipy.ndimage import gaussian_filter

    picture = np.asarray(picture, np.float64)
    return picture - gaussian_filter(picture, WIDTH, mode="nearest")
