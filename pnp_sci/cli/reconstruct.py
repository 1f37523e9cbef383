"""The command ``pnp-sci reconstruct``."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from typing import Any

import click

from pnp_sci.cli.inputs import calibrated, say_whose
from pnp_sci.cli.kinds import FILE, FOLDER, POSITIVE, SEED, Command
from pnp_sci.cli.options import bad_pixels, camera, camera_options, interactive, pairs, solver_options, stages
from pnp_sci.errors import SolverError


@click.command(cls=Command)
@click.argument("source", type=FILE, nargs=-1, required=True)
@click.option("--masks", "masks_file", type=FILE, help="File with the masks.")
@click.option("--calibration", type=FILE, help="File of `pnp-sci calibrate`: masks, dark frame, bad pixels.")
@click.option("--out", type=FOLDER, default=Path("video.zarr"), show_default=True, help="Folder for the result.")
@click.option("--key", help="Name of the measurements in their file, where it cannot be told.")
@click.option("--masks-key", help="Name of the masks in their file, where it cannot be told.")
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of the masks.")
@click.option("--workers", type=click.IntRange(min=1), help="Processes on this computer.  [default: one a core]")
@click.option("--scheduler", metavar="ADDRESS", help="Solve on the cluster of this dask scheduler, not here.")
@click.option("--preview", metavar="NAME", help="First quick results of all, by ofanet-fast, tv or another one.")
@click.option("--sequence", type=click.IntRange(min=1), help="So many consecutive measurements are one video.")
@solver_options
@camera_options
@click.option("--register", is_flag=True, help="Move the masks to where each measurement has them.")
@click.option("--time-budget", type=POSITIVE, help="Seconds for each chunk; results then vary from run to run.")
@click.option("--device", help="For priors that are networks, such as cuda.")
@click.option("--threads", type=click.IntRange(min=1), help="Of each process.  [default: cores / workers, elsewhere 1]")
@click.option("--uncertainty", is_flag=True, help="Predict the error of each pixel: twice the time.")
@click.option("--seed", default=0, type=SEED, show_default=True)
def reconstruct(
    source: tuple[Path, ...],
    masks_file: Path | None,
    calibration: Path | None,
    out: Path,
    masks_key: str | None,
    views: int | None,
    scheduler: str | None,
    prior: str,
    bad: str | None,
    bad_key: str | None,
    noise: str,
    gain: float | None,
    full_scale: float | None,
    bits: int | None,
    options: tuple[str, ...],
    **settings: Any,
) -> None:
    """Recover the videos of measurements from SOURCE on disk.

    SOURCE is a file (zarr, HDF5, NPY, TIFF stack), a folder of files, or several files. The same command goes on after
    it was killed.
    """
    given = masks_file or calibration
    if given is None or None not in (masks_file, calibration):
        raise click.UsageError("either --masks or --calibration was expected")
    prior_options, staged = pairs(options), stages(prior)
    import pnp_sci
    from pnp_sci.formats.arrays import CONTAINERS

    for option, file in (("--masks, --calibration", given), ("--bad", Path(bad or "auto"))):
        among = file.is_file() and any(file.resolve().parent == place.resolve() for place in source)
        if among and not (file.suffix.lower() in CONTAINERS and len(pnp_sci.io.describe(file)) > 1):
            came = f"{option} {file} is in the folder of the measurements, where each file counts as one"
            raise click.UsageError(f"{came}: keep it elsewhere")
    unused, black_level = bad_pixels(bad, bad_key), 0.0
    if calibration is None:
        say_whose(masks_file, None)
        masks = pnp_sci.io.read_masks(given, views, masks_key)
    else:
        masks, unused, full_scale, black_level = calibrated(calibration, unused, full_scale)
    with _estimates_shown():
        result = pnp_sci.reconstruct(
            source[0] if len(source) == 1 else list(source),
            masks,
            out,
            scheduler,
            prior=staged,
            noise=camera(noise, gain, full_scale, bits, black_level),
            bad=unused,
            progress=interactive(),
            **settings,
            **prior_options,
        )
    click.echo(repr(result))
    try:
        result.raise_for_status()
    except SolverError:
        for record in islice((record for record in result.records() if record["error"]), 10):
            click.echo(f"Measurement {record['measurement']}: {record['error']}", err=True)
        raise


@contextmanager
def _estimates_shown() -> Iterator[None]:
    """Context in which the log of estimates goes to stderr."""
    log, handler = logging.getLogger("pnp_sci.fleet"), logging.StreamHandler()
    before = log.level
    log.addHandler(handler)
    log.setLevel(logging.INFO)
    try:
        yield
    finally:
        log.setLevel(before)
        log.removeHandler(handler)
