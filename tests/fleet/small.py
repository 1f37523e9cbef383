"""A fleet of small measurements: ``from small import FAST, capture``."""

import numpy as np

import pnp_sci

FAST = {"prior": "tv", "iterations": 3}


def capture(count=5, views=1, frames=4, size=24, dtype=np.uint16):
    """Measurements (N, H, W) of moving bright squares, all different, and masks."""
    rng = np.random.default_rng(1)
    masks = pnp_sci.random_masks((views, frames, size, size), seed=1).astype(np.uint8)
    x = 50 + 40 * rng.random((count, views, frames, 1, 1)) + np.linspace(0, 60, size)
    return (masks * x.astype(np.float32)).sum((1, 2)).round().astype(dtype), masks
