"""What several commands of ``pnp-sci`` write."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    import numpy as np

    from pnp_sci.results.result import Result

SAVED = ".npz", ".h5", ".hdf5", ".mat"  # what holds a result, and several arrays
SHOWN = ".mp4", ".avi", ".mov", ".mkv", ".gif", ".tif", ".tiff", ".png"


def save_somewhere(result: Result, out: Path) -> Path:
    """Save a result at `out`, or else in the folder for temporary files: it may be the work of hours."""
    try:
        result.save(out)
        return out
    except OSError as error:
        other = Path(tempfile.mkdtemp(prefix="pnp-sci-")) / f"result{out.suffix}"
        result.save(other)
        click.echo(f"{out} cannot be written: {error}. The result is in {other}", err=True)
        return other


def print_scores(x: np.ndarray, truth: np.ndarray | None, peak: float | None = None) -> None:
    """PSNR and SSIM of each view, if the truth is known."""
    if truth is None:
        return
    from pnp_sci._validate import white
    from pnp_sci.bench.runner import scores

    largest = peak or white("reference", truth.dtype, float(truth.max(initial=0)))
    for view, (psnr, ssim) in enumerate(zip(*scores(x / largest, truth / largest)), 1):
        click.echo(f"View {view}: PSNR {psnr:.2f} dB, SSIM {ssim:.3f}")
