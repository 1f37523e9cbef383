"""What several commands of ``pnp-sci`` read from files: masks, and the true video."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci.errors import FormatError, InputError, InputTypeError

if TYPE_CHECKING:
    import numpy as np

    from pnp_sci.camera.calibration import Calibration


def masks_for(
    measurement: Path, masks_file: Path | None, calibration: Path | None, views: int | None, key: str | None
) -> np.ndarray:
    """The masks (V, B, H, W) of a measurement that has been read: of `masks_file`, `calibration`, or its own file."""
    from pnp_sci import io

    say_whose(masks_file, calibration)
    masks_file = masks_file or calibration
    if masks_file is None and len(io.describe(measurement)) == 1:
        there = "holds a single array of real numbers, no masks beside it"
        raise click.UsageError(f"{measurement} {there}: --masks FILE was expected")
    return io.read_masks(masks_file or measurement, views, key)


def say_whose(masks_file: Path | None, calibration: Path | None) -> None:
    """Say what is taken of which file, where both are given or masks are taken of a calibration."""
    from pnp_sci import io
    from pnp_sci.formats.arrays import CONTAINERS

    if masks_file is None:
        return
    keys = {entry.key for entry in io.describe(masks_file)} if masks_file.suffix.lower() in CONTAINERS else set()
    if calibration is not None:
        taken = f"the masks are those of {masks_file}, dark frame and bad pixels those of {calibration}"
        click.echo(f"--masks and --calibration: {taken}", err=True)
    elif {"dark", "bad", "crop"} <= keys:  # what Calibration.save writes
        left = f"the dark frame and the bad pixels of {masks_file} are not used"
        click.echo(f"Warning: --masks takes the masks only, {left}: --calibration takes all", err=True)


def calibrated(file: Path, bad: Any, full_scale: float | None) -> tuple[Calibration, Any, float | None, float]:
    """The calibration in a file, and bad pixels, full scale and black level of the measurements that it makes.

    `bad` and `full_scale` are what the options say of the camera.
    """
    import numpy as np

    from pnp_sci.camera.calibration import Calibration

    made = Calibration.load(file)
    made = made if full_scale is None else replace(made, full_scale=full_scale)
    if isinstance(bad, np.ndarray) and bad.shape != made.bad.shape:
        bad = made.cropped("bad", bad)
    return made, bad, made.saturation, made.black_level


def usable_truth(
    file: Path,
    shape: tuple[int, ...],
    count: int | None,
    index: int | None,
    key: str | None,
    peak: float | None,
    colour: bool = False,
) -> np.ndarray | None:
    """As :func:`true_video`, but a truth that cannot be used is left out with a warning: the result needs none.

    `count` is the number of measurements, None for one alone; `index` the one of them that is meant, None for all.
    """
    from pnp_sci.pipeline.reference import Reference

    try:
        truth = true_video(file, shape, count is not None, key, colour)
        truth, count = (truth, count) if index is None else (of_one(truth, count, index), None)
        Reference(truth, (count or 1, *shape, *(3,) * colour), peak)
    except (InputError, InputTypeError, FormatError) as error:
        click.echo(f"Warning: --reference is left out: {error}", err=True)
        return None
    return truth


def true_video(
    file: Path, shape: tuple[int, ...], several: bool, key: str | None = None, colour: bool = False
) -> np.ndarray:
    """The video of masks of this shape, (V, B, H, W), or those of several measurements, (N, V, B, H, W).

    In colour, with another axis of 3 at the end.
    """
    from pnp_sci import io

    views, frames, rows, columns = shape
    video = io.read_video(file, views, key, colour)
    colours = (3,) * colour
    if not several and video.shape == (1, *shape, *colours):  # the result of a stack of one
        return video[0]
    if several and video.shape[1:] == (*shape, *colours):
        return video
    fits = video.shape[2:] == (rows, columns, *colours) and video.shape[1] % frames == 0
    if not fits or (not several and video.shape[1] != frames):
        raise InputError(f"reference has shape {video.shape}, but masks {shape}: the same was expected")
    return video.reshape(views, -1, frames, rows, columns, *colours).swapaxes(0, 1) if several else video


def one_of(y: np.ndarray, masks: np.ndarray, bad: Any, index: int) -> tuple[np.ndarray, np.ndarray, Any]:
    """The measurement that ``--index`` stands for, its masks and its bad pixels: its own, or those of all."""
    if y.ndim == 2 or index >= len(y):
        count = 1 if y.ndim == 2 else len(y)
        raise click.BadParameter(f"{index} came, but the file has {count} measurements", param_hint="--index")
    if masks.ndim == 5 and len(masks) != len(y):
        raise InputError(f"masks are those of {len(masks)} measurements, but y has {len(y)}: the same was expected")
    own = getattr(bad, "shape", None) == y.shape
    return y[index], masks[index] if masks.ndim == 5 else masks, bad[index] if own else bad


def of_one(truth: np.ndarray, count: int | None, index: int) -> np.ndarray:
    """The true video of the measurement that ``--index`` stands for: of those of all `count`, or the only one."""
    if len(truth) not in (1, count):
        raise InputError(f"reference has {len(truth)} videos: one, or {count} as there are measurements, was expected")
    return truth[index if len(truth) > 1 else 0]
