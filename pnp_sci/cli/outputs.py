"""What several commands of ``pnp-sci`` write."""

from __future__ import annotations

import tempfile
from pathlib import Path
from shutil import rmtree
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    import numpy as np

    from pnp_sci.results.result import Result

SAVED = ".npz", ".h5", ".hdf5", ".mat", ".zarr"  # what holds a result
ARRAYS = ".npz", ".h5", ".hdf5", ".mat"  # ... and several arrays
FILMS = ".mp4", ".avi", ".mov", ".mkv", ".gif"
SHOWN = *FILMS, ".tif", ".tiff", ".png"


class White(click.ParamType):
    """What is white: a number, one a view with commas between them, or "view"."""

    name = "NUMBER|view"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The `white` of :meth:`pnp_sci.Result.export`."""
        if value == "view":
            return value
        try:
            levels = [float(word) for word in value.split(",")]
        except ValueError:
            levels = []
        if not levels or not all(0 < level < float("inf") for level in levels):
            self.fail(f"{value!r} came: a number > 0, one a view such as 1,0.2, or view was expected", param, ctx)
        return levels if len(levels) > 1 else levels[0]


def check_white(white: Any, views: int) -> None:
    """Raise an error, before any work, if ``--white`` has values for another number of views."""
    if isinstance(white, list) and len(white) != views:
        came = f"{len(white)} values came: one, or {views} of them (one a view), was expected"
        raise click.BadParameter(came, param_hint="--white")


def named(file: Path, fps: float) -> str:
    """A file that was written; of a film with its speed.

    >>> named(Path("views.gif"), 5.0)
    'views.gif (5 frames per second)'
    """
    return f"{file} ({fps:g} frames per second)" if file.suffix.lower() in FILMS else str(file)


def save_somewhere(result: Result, out: Path) -> Path:
    """Save a result at `out`, or else in the folder for temporary files: it may be the work of hours."""
    try:
        result.save(out)
        return out
    except Exception as error:  # of whatever library: the result is kept all the same
        folder = Path(tempfile.mkdtemp(prefix="pnp-sci-"))
        try:
            result.save(folder / "result.npz")
        except OSError as again:
            rmtree(folder, ignore_errors=True)
            raise OSError(f"{out} cannot be written: {error}; nor can {folder.parent}: {again}") from error
        click.echo(f"{out} cannot be written: {error}. The result is in {folder / 'result.npz'}", err=True)
        return folder / "result.npz"


def print_scores(x: np.ndarray, truth: np.ndarray | None, peak: float | None = None, colour: bool = False) -> None:
    """PSNR and SSIM of each view, if the truth is known."""
    if truth is None:
        return
    from pnp_sci._validate import white
    from pnp_sci.bench.runner import scores

    largest = peak or white("reference", truth.dtype, float(truth.max(initial=0)))
    for view, (psnr, ssim) in enumerate(zip(*scores(x / largest, truth / largest, colour)), 1):
        click.echo(f"View {view}: PSNR {psnr:.2f} dB, SSIM {ssim:.3f}")
