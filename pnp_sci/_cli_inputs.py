"""What several commands of ``pnp-sci`` read from the command line and from files."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING

import click

from .errors import InputError

if TYPE_CHECKING:
    import numpy as np

FILE = click.Path(exists=True, path_type=Path)
OUTPUT = click.Path(path_type=Path)


def interactive() -> bool:
    """Whether somebody watches: only then progress is shown."""
    return sys.stderr.isatty()


def noise_level(text: str) -> str | float:
    """What ``--noise`` stands for."""
    if text == "auto":
        return text
    try:
        return float(text)
    except ValueError:
        raise click.BadParameter(f"{text!r} came, auto or a number was expected", param_hint="--noise") from None


def true_video(file: Path, shape: tuple[int, ...], several: bool) -> np.ndarray:
    """The video of masks of this shape, (V, B, H, W), or those of several measurements, (N, V, B, H, W)."""
    from . import io

    views, frames, rows, columns = shape
    video = io.read_video(file, views)
    if video.shape[1] % frames or video.shape[2:] != (rows, columns) or (not several and video.shape[1] != frames):
        raise InputError(f"reference has shape {video.shape}, but masks {shape}: the same was expected")
    return video.reshape(views, -1, frames, rows, columns).swapaxes(0, 1) if several else video


def one_of(y: np.ndarray, index: int) -> np.ndarray:
    """The measurement that ``--index`` stands for."""
    if y.ndim == 2 or index >= len(y):
        count = 1 if y.ndim == 2 else len(y)
        raise click.BadParameter(f"{index} came, but the file has {count} measurements", param_hint="--index")
    return y[index]
