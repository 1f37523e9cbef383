"""The command ``pnp-sci solve``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from pnp_sci.cli.inputs import calibrated, masks_for, one_of, usable_truth
from pnp_sci.cli.kinds import FILE, POSITIVE, SEED, Command, Output
from pnp_sci.cli.options import (
    bad_pixels,
    camera,
    camera_options,
    file_options,
    interactive,
    pairs,
    solver_options,
    stages,
)
from pnp_sci.cli.outputs import SAVED, SHOWN, White, check_white, named, print_scores, save_somewhere


@click.command(cls=Command)
@click.argument("measurement", type=FILE)
@file_options
@click.option("--index", type=click.IntRange(min=0), help="Of several measurements, this one (from 0).")
@solver_options
@camera_options
@click.option("--register", is_flag=True, help="First move the masks to where the measurement has them.")
@click.option("--time-budget", type=POSITIVE, help="Seconds to stop after.")
@click.option("--device", help="Where it runs, such as cuda.")
@click.option("--backend", help="numba or torch.  [default: torch where the device is not the CPU]")
@click.option("--threads", type=click.IntRange(min=1), help="At most so many.  [default: one a core]")
@click.option("--uncertainty", is_flag=True, help="Predict the error of each pixel: twice the time.")
@click.option("--sequence", is_flag=True, help="The measurements follow one another: solve them as one video.")
@click.option("--seed", default=0, type=SEED, show_default=True)
@click.option("--mosaic", help="Colour filters of the camera: RGGB, BGGR, GRBG or GBRG.  [default: grey]")
@click.option("--reference", type=FILE, help="File with the true video, to score the result.")
@click.option("--reference-key", help="Name of the true video in its file, where it cannot be told.")
@click.option("--peak", type=POSITIVE, help="White in the true video.  [default: 1, or of 8, 10, 12, 14, 16 bits]")
@click.option(
    "--out",
    type=Output(*SAVED),
    default=Path("result.npz"),
    show_default=True,
    help="Result: .npz, .h5, .hdf5, .mat or .zarr.",
)
@click.option("--video", type=Output(*SHOWN), help="To look at: .mp4, .avi, .gif, .png; .tif, .ome.tif: the values.")
@click.option("--fps", type=POSITIVE, default=10.0, show_default=True, help="Frames per second of --video.")
@click.option("--white", type=White(), help="White in --video, or one a view: 1,0.2; view: each its own.")
def solve(
    measurement: Path,
    masks_file: Path | None,
    calibration: Path | None,
    views: int | None,
    key: str | None,
    masks_key: str | None,
    index: int | None,
    prior: str,
    bad: str | None,
    bad_key: str | None,
    noise: str,
    gain: float | None,
    full_scale: float | None,
    bits: int | None,
    options: tuple[str, ...],
    reference: Path | None,
    reference_key: str | None,
    peak: float | None,
    out: Path,
    video: Path | None,
    fps: float,
    white: Any,
    **settings: Any,
) -> None:
    """Recover the video of each view from MEASUREMENT.

    The file may hold one measurement or several.
    """
    prior_options, staged = pairs(options), stages(prior)
    from pnp_sci import api, io

    y = io.read_measurement(measurement, key)
    masks = masks_for(measurement, masks_file, calibration, views, masks_key)
    unused, black_level = bad_pixels(bad, bad_key), 0.0
    if calibration is not None:
        made, unused, full_scale, black_level = calibrated(calibration, unused, full_scale)
        y = made.correct(y)
    sensor = camera(noise, gain, full_scale, bits, black_level)
    shape, colour, count = masks.shape[-4:], settings["mosaic"] is not None, len(y) if y.ndim == 3 else None
    check_white(white, shape[0])
    if index is not None:
        y, masks, unused = one_of(y, masks, unused, index)
    truth = None if reference is None else usable_truth(reference, shape, count, index, reference_key, peak, colour)
    result = api.solve(
        y, masks, staged,
        noise=sensor, bad=unused, reference=truth, peak=peak, progress=interactive(), **settings, **prior_options,
    )  # fmt: skip
    written = [str(save_somewhere(result, out))]
    if video is not None:
        result.export(video, fps, white)
        written.append(named(video, fps))
    click.echo(repr(result))
    print_scores(result.x, truth, peak, colour)
    click.echo(f"Written: {', '.join(written)}")
    result.raise_for_status()
