"""What several commands of ``pnp-sci`` write."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import numpy as np

SAVED = ".npz", ".h5", ".hdf5"  # what holds a result
ARRAYS = *SAVED, ".mat"  # ... and several arrays
SHOWN = ".mp4", ".avi", ".mov", ".mkv", ".gif", ".tif", ".tiff", ".png"


def print_scores(x: np.ndarray, truth: np.ndarray | None) -> None:
    """PSNR and SSIM of each view, if the truth is known."""
    if truth is None:
        return
    from pnp_sci._validate import white
    from pnp_sci.bench.runner import scores

    largest = white("reference", truth.dtype)
    for view, (psnr, ssim) in enumerate(zip(*scores(x / largest, truth / largest)), 1):
        click.echo(f"View {view}: PSNR {psnr:.2f} dB, SSIM {ssim:.3f}")
