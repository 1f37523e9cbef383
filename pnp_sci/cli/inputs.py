"""What several commands of ``pnp-sci`` read from the command line and from files."""

from __future__ import annotations

import json
import os
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError, InputTypeError, MissingExtraError
from pnp_sci.formats.replacing import check_writable, same_file

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np

    from pnp_sci.sensing.sensor import Sensor

FILE = click.Path(exists=True, path_type=Path)


NEEDED = {  # package and extra that a format of outputs needs
    **dict.fromkeys((".h5", ".hdf5"), ("h5py", "hdf5")),
    **dict.fromkeys((".mp4", ".avi", ".mov", ".mkv", ".gif"), ("imageio_ffmpeg", "video")),
    ".zarr": ("zarr", "zarr"),
}


class Output(click.Path):
    """A path that something can be written to, in one of these formats: that is known before any work is done.

    `needs` is the package that writes it, and its extra; by default as the format needs it.
    """

    def __init__(self, *suffixes: str, needs: tuple[str, str] | None = None):
        super().__init__(path_type=Path)
        self.suffixes, self.needs = suffixes, needs

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, if it can be written to."""
        path = Path(super().convert(value, param, ctx))  # type: ignore[arg-type]
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            came = path.suffix or "no suffix"
            self.fail(f"{path}: {came} came, one of these was expected: {', '.join(self.suffixes)}", param, ctx)
        try:
            check_writable(path)
            if needs := self.needs or NEEDED.get(path.suffix.lower()):
                with needed_for(str(path), needs[1]):
                    import_module(needs[0])
        except OSError as error:
            self.fail(f"{path}: {error.strerror}" if error.filename else str(error), param, ctx)
        except MissingExtraError as error:
            self.fail(str(error), param, ctx)
        return path


class Folder(click.Path):
    """A folder for outputs, which is made where it is missing."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, if it is a folder or can be made."""
        path = Path(super().convert(value, param, ctx))  # type: ignore[arg-type]
        there = next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())
        if not there.is_dir() or not os.access(there, os.W_OK):
            what = "is a file, where a folder was expected" if there.is_file() else "cannot be written to"
            self.fail(f"{path}: {there} {what}", param, ctx)
        return path


class Command(click.Command):
    """A command that refuses, before any work, to write over one of its inputs or twice to the same file."""

    def invoke(self, ctx: click.Context) -> Any:
        """Check the paths, then run the command."""
        inputs, outputs = [], []
        for param in self.params:
            value = ctx.params.get(param.name or "")
            paths = [p for p in (value if isinstance(value, tuple) else [value]) if isinstance(p, Path)]
            if param.type is FILE:
                inputs += [(param.human_readable_name, path) for path in paths]
            elif isinstance(param.type, click.Path):
                outputs += [(param.opts[0], path) for path in paths]
            elif isinstance(value, str):  # a name or a file, or several
                inputs += [(param.opts[0], Path(word)) for word in value.split(",") if Path(word).is_file()]
        for n, (option, path) in enumerate(outputs):
            for other, taken in inputs + outputs[:n]:
                if same_file(path, taken):
                    raise click.UsageError(f"{option} {path} is the file of {other}: it would be lost")
        return super().invoke(ctx)


FOLDER = Folder(path_type=Path)
FIGURE = Output(".svg", ".png", ".pdf", needs=("matplotlib", "plot"))
PAGE = Output(needs=("jinja2", "report"))
SEED = click.IntRange(min=0)
POSITIVE = click.FloatRange(min=0, min_open=True)


def interactive() -> bool:
    """Whether somebody watches: only then progress is shown."""
    return sys.stderr.isatty()


def solver_options(command: Callable) -> Callable:
    """Options of :func:`pnp_sci.solve` for a command that solves."""
    prior = "One of `pnp-sci priors`, a+b, or stages a:60,b:20."
    first = "First estimate; auto: a network's for learned priors."
    for option in (
        click.option("--iterations", type=click.IntRange(min=1), help="At most so many."),
        click.option("--effort", default="balanced", show_default=True, help="fast, balanced or best."),
        click.option("--init", default="auto", show_default=True, help=first),
        click.option("--algorithm", default="gap", show_default=True, help="gap, plain-gap or admm."),
        click.option("--prior", default="tv", show_default=True, help=prior),
    ):
        command = option(command)
    return command


def camera_options(command: Callable) -> Callable:
    """The options that :func:`camera` and :func:`bad_pixels` take, for a command."""
    bad = "Picture that is not 0 in bad pixels, which are not used; or auto: hot and dead ones are found."
    noise = "Standard deviation of the noise, with --gain of that in the dark, in units of y; or auto."
    for option in (
        click.option("--bad", metavar="FILE|auto", help=bad),
        click.option("--bits", type=click.IntRange(1, 32), help="Grey levels of the camera, up to --full-scale."),
        click.option("--full-scale", type=POSITIVE, help="The camera's largest value: pixels there are saturated."),
        click.option("--gain", type=POSITIVE, help="Units of y an electron, for photon noise.  [default: none]"),
        click.option("--noise", default="auto", show_default=True, help=noise),
    ):
        command = option(command)
    return command


def camera(noise: str, gain: float | None, full_scale: float | None, bits: int | None) -> str | float | Sensor:
    """What the options of the camera stand for: the `noise` of :func:`pnp_sci.solve`."""
    try:
        level = noise if noise == "auto" else float(noise)
    except ValueError:
        raise click.BadParameter(f"{noise!r} came, auto or a number was expected", param_hint="--noise") from None
    if (gain, full_scale, bits) == (None, None, None):
        return level
    from pnp_sci.sensing.sensor import Sensor

    try:
        return Sensor(level, gain or 0.0, full_scale, bits)  # type: ignore[arg-type]
    except InputError as error:
        raise click.BadParameter(str(error), param_hint="--noise, --gain, --full-scale, --bits") from error


def bad_pixels(bad: str | None) -> Any:
    """What ``--bad`` stands for: the `bad` of :func:`pnp_sci.solve`."""
    if bad is None or bad == "auto":
        return bad
    if not Path(bad).is_file():
        raise click.BadParameter(f"{bad!r} came, a file or auto was expected", param_hint="--bad")
    from pnp_sci import io

    return io.read(bad) != 0


def masks_for(measurement: Path, masks_file: Path | None, views: int | None, key: str | None) -> np.ndarray:
    """The masks (V, B, H, W) of a measurement: those of `masks_file`, by default of its own file."""
    from pnp_sci import io

    if masks_file is None and len(io.describe(measurement)) == 1:
        raise click.UsageError(f"{measurement} holds a single array, no masks beside it: --masks FILE was expected")
    return io.read_masks(masks_file or measurement, views, key)


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


def one_of(y: np.ndarray, masks: np.ndarray, index: int) -> tuple[np.ndarray, np.ndarray]:
    """The measurement that ``--index`` stands for, and its masks: its own, or those of all."""
    if y.ndim == 2 or index >= len(y):
        count = 1 if y.ndim == 2 else len(y)
        raise click.BadParameter(f"{index} came, but the file has {count} measurements", param_hint="--index")
    if masks.ndim == 5 and len(masks) != len(y):
        raise InputError(f"masks are those of {len(masks)} measurements, but y has {len(y)}: the same was expected")
    return y[index], masks[index] if masks.ndim == 5 else masks


def of_one(truth: np.ndarray, count: int | None, index: int) -> np.ndarray:
    """The true video of the measurement that ``--index`` stands for: of those of all `count`, or the only one."""
    if len(truth) not in (1, count):
        raise InputError(f"reference has {len(truth)} videos: one, or {count} as there are measurements, was expected")
    return truth[index if len(truth) > 1 else 0]


def pairs(options: tuple[str, ...]) -> dict[str, Any]:
    """``("inner=5", "mode=iso")`` -> ``{"inner": 5, "mode": "iso"}``."""
    pairs = {}
    for option in options:
        key, separator, value = option.partition("=")
        if not separator or not key.isidentifier():
            raise click.BadParameter(f"{option!r} came, KEY=VALUE was expected", param_hint="--option")
        try:
            pairs[key] = json.loads(value)
        except json.JSONDecodeError:
            pairs[key] = value
    return pairs


def stages(text: str) -> str | list[tuple[str, int]]:
    """``"tv:60,wavelet:20"`` -> stages; anything else is a name."""
    if ":" not in text:
        return text
    parts = [stage.partition(":")[::2] for stage in text.split(",")]
    if not all(name and count.isdigit() for name, count in parts):
        raise click.BadParameter(f"{text!r} came, NAME:ITERATIONS,... was expected", param_hint="--prior")
    return [(name, int(count)) for name, count in parts]
