"""The command ``pnp-sci simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pnp_sci.cli.kinds import FILE, SEED, Command, Output
from pnp_sci.cli.outputs import ARRAYS
from pnp_sci.errors import InputError

if TYPE_CHECKING:
    import numpy as np

BRIGHTEST = 2.0  # of a video of floats: interpolation may leave [0, 1], grey levels up to 255 are another scale


@click.command(cls=Command)
@click.argument("videos", nargs=-1, required=True, type=FILE)
@click.option("--masks", default="moving", show_default=True, help="moving, random, or a file.")
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of a single video file.")
@click.option("--frames", type=click.IntRange(min=1), help="The first so many of each view.  [default: all]")
@click.option(
    "--noise", default=0.0, type=click.FloatRange(min=0), show_default=True, help="Relative to the peak of y."
)
@click.option("--bits", type=click.IntRange(1, 32), help="Grey levels of the camera.")
@click.option("--seed", default=0, type=SEED, show_default=True, help="Of the masks and the noise.")
@click.option("--mosaic", help="Colour filters of the camera: RGGB, BGGR, GRBG or GBRG.  [default: grey]")
@click.option("--out", type=Output(*ARRAYS), default=Path("meas.npz"), show_default=True, help=".npz, .h5 or .mat")
def simulate(
    videos: tuple[Path, ...],
    masks: str,
    views: int | None,
    frames: int | None,
    noise: float,
    bits: int | None,
    seed: int,
    mosaic: str | None,
    out: Path,
) -> None:
    """Measure VIDEOS, a file for each view or one for all.

    Writes the measurement y, the masks and the true video x.
    """
    import numpy as np

    from pnp_sci import io
    from pnp_sci.masks import moving_masks, random_masks
    from pnp_sci.sensing.simulate import simulate as measure

    makers = {"moving": moving_masks, "random": random_masks}
    if masks not in makers and not Path(masks).exists():
        raise click.BadParameter(f"{masks!r} came, moving, random or a file was expected", param_hint="--masks")
    x = _views(videos, views, frames, mosaic is not None)
    phi = makers[masks](x.shape[:4], seed=seed) if masks in makers else io.read_masks(masks, len(x))
    y = measure(x, phi, noise, seed, bits, mosaic=mosaic)
    in_matlab = mosaic is not None and out.suffix.lower() == ".mat"  # rows, columns, then colours
    io.write(out, {"y": y, "masks": phi, "x": np.moveaxis(x, -1, -3) if in_matlab else x})
    click.echo(f"{len(x)} views x {x.shape[1]} frames of {x.shape[2]} x {x.shape[3]} in one measurement")
    click.echo(f"Written: {out}")


def _views(files: tuple[Path, ...], views: int | None, frames: int | None, colour: bool) -> np.ndarray:
    """The videos of all views, (V, B, H, W) or in colour (V, B, H, W, 3), in [0, 1] if they are of whole numbers."""
    import numpy as np

    from pnp_sci import io

    if len(files) == 1:
        x = io.read_video(files[0], views, None, colour)
        if x.ndim == 5 + colour:
            raise InputError(f"{files[0]} holds the videos of {len(x)} measurements: those of one were expected")
        if frames is not None and frames > x.shape[1]:
            raise InputError(f"frames is {frames}, but {files[0]} has {x.shape[1]}")
        return _unit_range(x[:, :frames])
    films = [io.read_video(file, 1, None, colour)[0] for file in files]
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
        one = white("video", video.dtype, float(video.max(initial=0)))
        if video.dtype.itemsize == 2 and one < 65535:
            came = f"the video has values up to {video.max()} in uint16: white is taken to be {one:g}"
            click.echo(f"Warning: {came}; for another one, store floats in [0, 1]", err=True)
        return (video / one).astype("float32")
    if video.size and video.max() > BRIGHTEST:
        raise InputError(f"video has values up to {video.max():g}: floats in [0, 1] were expected, 1 being white")
    return video
