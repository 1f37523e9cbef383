"""The command ``pnp-sci``. Everything heavy is imported by the command that needs it."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci.cli.bench import bench
from pnp_sci.cli.compare import compare
from pnp_sci.cli.inputs import FILE, FOLDER, Output, camera, camera_options, interactive, masks_for, one_of, true_video
from pnp_sci.errors import InputError, UnknownPluginError

if TYPE_CHECKING:
    import numpy as np

    from pnp_sci.results.result import Result


SAVED = ".npz", ".h5", ".hdf5"  # what holds a result
ARRAYS = *SAVED, ".mat"  # ... and several arrays
SHOWN = ".mp4", ".avi", ".mov", ".mkv", ".gif", ".tif", ".tiff", ".png"
BRIGHTEST = 2.0  # of a video of floats: interpolation may leave [0, 1], grey levels up to 255 are another scale


class _Commands(click.Group):
    """Failures are one line on stderr and exit code 1 (2: the command line is at fault); --debug shows them whole."""

    def invoke(self, ctx: click.Context) -> Any:
        if ctx.params["debug"]:
            return super().invoke(ctx)
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except UnknownPluginError as error:
            raise click.UsageError(str(error)) from error
        except Exception as error:
            text = " ".join(str(error).split())
            known = isinstance(error, (ValueError, TypeError, OSError, RuntimeError, ImportError)) and text
            raise click.ClickException(text if known else f"{type(error).__name__}: {text}") from error


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="pnp-sci")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """Videos from snapshot compressive measurements, of one view, two, or more.

    Exit codes: 0 done, 1 failed, 2 wrong command line.
    """


@main.command()
@click.option("--out", type=FOLDER, default=Path(), help="Folder for demo.png and demo.mp4.  [default: this one]")
@click.option("--size", default=256, show_default=True, help="Rows and columns of the scene.")
def demo(out: Path, size: int) -> None:
    """Recover the two videos of the embedded scene with total variation, and score them."""
    from pnp_sci import datasets
    from pnp_sci.api import solve

    scene = datasets.embedded_scene(size)

    def timed(progress: bool) -> tuple[Result, float]:
        start = time.perf_counter()
        return solve(scene.y, scene.masks, "tv", progress=progress), time.perf_counter() - start

    _, first = timed(interactive())  # loads kernels, and compiles them where that has not been done
    result, seconds = timed(False)
    _print_scores(result.x, scene.truth)
    click.echo(f"{seconds:.2f} seconds for {result.history[-1].iteration} iterations: {result.status.value}")
    click.echo(f"({first:.2f} seconds the first time, when kernels are loaded and, in a new installation, compiled.)")
    out.mkdir(parents=True, exist_ok=True)
    result.plot(reference=scene.truth).savefig(out / "demo.png", dpi=110)
    result.export(out / "demo.mp4")
    click.echo(f"Written: {out / 'demo.png'}, {out / 'demo.mp4'}")
    result.raise_for_status()


@main.command()
@click.argument("measurement", type=FILE)
@click.option("--masks", "masks_file", type=FILE, help="File with the masks.  [default: the measurement's]")
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of the masks.")
@click.option("--key", help="Name of the measurement in its file, where it cannot be told.")
@click.option("--masks-key", help="Name of the masks in their file, where it cannot be told.")
@click.option("--index", type=click.IntRange(min=0), help="Of several measurements, this one (from 0).")
@click.option("--prior", default="tv", show_default=True, help="One of `pnp-sci priors`, a+b, or stages a:60,b:20.")
@click.option("--algorithm", default="gap", show_default=True, help="gap, plain-gap or admm.")
@click.option("--init", default="auto", show_default=True, help="First estimate; auto: a network's for learned priors.")
@click.option("--effort", default="balanced", show_default=True, help="fast, balanced or best.")
@click.option("--iterations", type=click.IntRange(min=1), help="At most so many.")
@camera_options
@click.option("--time-budget", type=click.FloatRange(min=0, min_open=True), help="Seconds to stop after.")
@click.option("--device", help="For priors that are networks, such as cuda.")
@click.option("--threads", type=click.IntRange(min=1), help="At most so many.  [default: one a core]")
@click.option("--seed", default=0, show_default=True)
@click.option("--option", "options", multiple=True, metavar="KEY=VALUE", help="Option of the prior; may be repeated.")
@click.option("--reference", type=FILE, help="File with the true video, to score the result.")
@click.option(
    "--out", type=Output(*SAVED), default=Path("result.npz"), show_default=True, help="Result: .npz, .h5, .hdf5."
)
@click.option("--video", type=Output(*SHOWN), help="For looking at: .mp4, .avi, .gif, .tif or .png.")
def solve(
    measurement: Path,
    masks_file: Path | None,
    views: int | None,
    key: str | None,
    masks_key: str | None,
    index: int | None,
    prior: str,
    noise: str,
    gain: float | None,
    full_scale: float | None,
    bits: int | None,
    options: tuple[str, ...],
    reference: Path | None,
    out: Path,
    video: Path | None,
    **settings: Any,
) -> None:
    """Recover the video of each view from MEASUREMENT, a file with one or several."""
    prior_options, stages = _pairs(options), _prior(prior)
    sensor = camera(noise, gain, full_scale, bits)
    from pnp_sci import api, io

    masks = masks_for(measurement, masks_file, views, masks_key)
    y = io.read_measurement(measurement, key)
    truth = None if reference is None else true_video(reference, masks.shape, y.ndim == 3)
    if index is not None:
        y, truth = one_of(y, truth, index)
    result = api.solve(
        y, masks, stages, noise=sensor, reference=truth, progress=interactive(), **settings, **prior_options
    )
    result.save(out)
    written = [out]
    if video is not None:
        result.export(video)
        written.append(video)
    click.echo(repr(result))
    _print_scores(result.x, truth)
    click.echo(f"Written: {', '.join(map(str, written))}")
    result.raise_for_status()


@main.command()
@click.argument("videos", nargs=-1, required=True, type=FILE)
@click.option("--masks", default="moving", show_default=True, help="moving, random, or a file.")
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of a single video file.")
@click.option("--frames", type=click.IntRange(min=1), help="The first so many of each view.  [default: all]")
@click.option(
    "--noise", default=0.0, type=click.FloatRange(min=0), show_default=True, help="Relative to the peak of y."
)
@click.option("--bits", type=click.IntRange(1, 32), help="Grey levels of the camera.")
@click.option("--seed", default=0, show_default=True, help="Of the masks and the noise.")
@click.option("--out", type=Output(*ARRAYS), default=Path("meas.npz"), show_default=True, help=".npz, .h5 or .mat")
def simulate(
    videos: tuple[Path, ...],
    masks: str,
    views: int | None,
    frames: int | None,
    noise: float,
    bits: int | None,
    seed: int,
    out: Path,
) -> None:
    """Measure VIDEOS, a file for each view or one for all, and write y, the masks and the true video x."""
    from pnp_sci import io
    from pnp_sci.masks import moving_masks, random_masks
    from pnp_sci.sensing.simulate import simulate as measure

    x = _views(videos, views, frames)
    makers = {"moving": moving_masks, "random": random_masks}
    phi = makers[masks](x.shape, seed=seed) if masks in makers else io.read_masks(masks, len(x))
    y = measure(x, phi, noise, seed, bits)
    io.write(out, {"y": y, "masks": phi, "x": x})
    click.echo(f"{len(x)} views x {x.shape[1]} frames of {x.shape[2]} x {x.shape[3]} in one measurement")
    click.echo(f"Written: {out}")


@main.command()
@click.argument("file", type=FILE)
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of the masks.")
def info(file: Path, views: int | None) -> None:
    """Say what is in FILE: its arrays, how well its masks code, how its result was obtained."""
    from pnp_sci import io
    from pnp_sci.masks import condition

    entries = io.describe(file)
    if {"x", "history"} <= {entry.key for entry in entries}:
        from pnp_sci.results.result import Result

        result = Result.load(file)
        click.echo(f"{result!r}\n{json.dumps(result.settings, indent=2)}")
        return
    for entry in entries:
        click.echo(f"{entry.key:12s} {' x '.join(map(str, entry.shape)):22s} {entry.dtype:8s} {entry.meaning}")
    for entry in entries:
        if entry.meaning.startswith("masks"):
            click.echo(f"\n{condition(io.read_masks(file, views, entry.key))}")


@main.command()
@click.argument("seconds", type=click.FloatRange(min=0, min_open=True))
@click.option("--like", default="dualview", show_default=True, help="dualview, singleview, a scene, or VxBxHxW.")
@click.option("--results", type=FILE, help="File written by `pnp-sci bench`.  [default: what comes with the package]")
def recommend(seconds: float, like: str, results: Path | None) -> None:
    """Say which method to take if a measurement may take so many SECONDS on this machine."""
    from pnp_sci.advice.recommend import recommend as choose

    sides = like.split("x")
    size = tuple(map(int, sides)) if len(sides) == 4 and all(side.isdigit() for side in sides) else like
    advice = choose(seconds, size, results)
    click.echo(f"{advice.python}\n{advice.psnr:.2f} dB on {', '.join(advice.cases)}; {advice.seconds:.2g} s here")


main.add_command(bench)
main.add_command(compare)


@main.command()
def priors() -> None:
    """List the priors and decoders that are installed."""
    from pnp_sci.plugins import registry

    for kind, title in {"priors": "Priors", "decoders": "Decoders, also for --init"}.items():
        plugins = registry.available(kind)
        if plugins:
            click.echo(f"{title}:")
        for name, plugin in plugins.items():
            click.echo(f"  {name:12s} {_summary(plugin)}")


def _summary(plugin: Any) -> str:
    """The first line of a plugin's docstring, or why it cannot be loaded."""
    from importlib.metadata import EntryPoint

    try:
        loaded = plugin.load() if isinstance(plugin, EntryPoint) else plugin
    except ImportError as error:
        return f"(cannot be loaded: {error})"
    return (loaded.__doc__ or "").strip().partition("\n")[0]


def _print_scores(x: np.ndarray, truth: np.ndarray | None) -> None:
    if truth is None:
        return
    from pnp_sci._validate import white
    from pnp_sci.bench.runner import scores

    largest = white("reference", truth.dtype)
    for view, (psnr, ssim) in enumerate(zip(*scores(x / largest, truth / largest)), 1):
        click.echo(f"View {view}: PSNR {psnr:.2f} dB, SSIM {ssim:.3f}")


def _pairs(options: tuple[str, ...]) -> dict[str, Any]:
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


def _prior(text: str) -> str | list[tuple[str, int]]:
    """``"tv:60,wavelet:20"`` -> stages; anything else is a name."""
    if ":" not in text:
        return text
    stages = [stage.partition(":")[::2] for stage in text.split(",")]
    if not all(name and count.isdigit() for name, count in stages):
        raise click.BadParameter(f"{text!r} came, NAME:ITERATIONS,... was expected", param_hint="--prior")
    return [(name, int(count)) for name, count in stages]


def _views(files: tuple[Path, ...], views: int | None, frames: int | None) -> np.ndarray:
    """The videos of all views, (V, B, H, W), in [0, 1] if they are of whole numbers."""
    import numpy as np

    from pnp_sci import io

    if len(files) == 1:
        x = io.read_video(files[0], views)
        if x.ndim == 5:
            raise InputError(f"{files[0]} holds the videos of {len(x)} measurements: those of one were expected")
        if frames is not None and frames > x.shape[1]:
            raise InputError(f"frames is {frames}, but {files[0]} has {x.shape[1]}")
        return _unit_range(x[:, :frames])
    films = [io.read_video(file, 1)[0] for file in files]
    count = frames or min(map(len, films))
    for file, film in zip(files, films):
        if len(film) < count or film.shape[1:] != films[0].shape[1:]:
            raise InputError(
                f"{file} has {len(film)} frames of {film.shape[1]} x {film.shape[2]}: {count} of "
                f"{films[0].shape[1]} x {films[0].shape[2]} were expected, as the first video has them"
            )
    return _unit_range(np.stack([film[:count] for film in films]))


def _unit_range(video: np.ndarray) -> np.ndarray:
    """Grey levels as float32 in [0, 1]; floats stay."""
    from pnp_sci._validate import white

    if video.dtype.kind != "f":
        return (video / white("video", video.dtype)).astype("float32")
    if video.size and video.max() > BRIGHTEST:
        raise InputError(f"video has values up to {video.max():g}: floats in [0, 1] were expected, 1 being white")
    return video
