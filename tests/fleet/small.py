"""A fleet of small measurements: ``from small import FAST, capture, files``."""

import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import pnp_sci

FAST = {"prior": "tv", "iterations": 3}


def capture(count=5, views=1, frames=4, size=24, dtype=np.uint16):
    """Measurements (N, H, W) of moving bright squares, all different, and masks."""
    rng = np.random.default_rng(1)
    masks = pnp_sci.random_masks((views, frames, size, size), seed=1).astype(np.uint8)
    x = 50 + 40 * rng.random((count, views, frames, 1, 1)) + np.linspace(0, 60, size)
    return (masks * x.astype(np.float32)).sum((1, 2)).round().astype(dtype), masks


def files(folder, array="0"):
    """The content of all files of an array by name, of each measurement those of its videos."""
    return {str(f.relative_to(folder)): f.read_bytes() for f in (folder / array).rglob("*") if f.is_file()}


@dataclass(frozen=True)
class Deadly:
    """A prior that kills its process while a file is there."""

    file: str

    def __call__(self, x, sigma):
        """The same, if it gets there."""
        if Path(self.file).with_suffix(".armed").exists():
            os._exit(1)
        return 0.9 * x
