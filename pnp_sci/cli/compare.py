"""The command ``pnp-sci compare``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pnp_sci.cli.inputs import calibrated, masks_for, of_one, one_of, true_video
from pnp_sci.cli.kinds import FILE, PAGE, SEED, Command, Output
from pnp_sci.cli.options import bad_pixels, camera, camera_options, file_options, grid_options, interactive, words

if TYPE_CHECKING:
    from pnp_sci.bench import Comparison, Trial


@click.command(cls=Command)
@click.argument("measurement", type=FILE)
@file_options
@click.option("--index", type=click.IntRange(min=0), help="Of several measurements, this one (from 0).  [default: 0]")
@click.option("--truth", "--reference", "truth_file", type=FILE, help="The true video: PSNR, SSIM, error maps.")
@click.option("--reference-key", help="Name of the true video in its file, where it cannot be told.")
@click.option("--priors", default="tv,wavelet,flow", show_default=True, help="Comma-separated; a+b joins two.")
@grid_options
@camera_options
@click.option("--device", help="For priors that are networks, such as cuda.")
@click.option("--seed", default=0, type=SEED, show_default=True, help="For priors that draw random numbers.")
@click.option("--title", help="Heading of the report.  [default: names the measurement's file]")
@click.option("--html", "html_file", type=PAGE, help="Write a report for the browser, one file.")
@click.option("--json", "json_file", type=Output(), help="Write the table with all settings as JSON.")
def compare(
    measurement: Path,
    masks_file: Path | None,
    calibration: Path | None,
    views: int | None,
    key: str | None,
    masks_key: str | None,
    index: int | None,
    truth_file: Path | None,
    reference_key: str | None,
    iterations: int | None,
    bad: str | None,
    bad_key: str | None,
    noise: str,
    gain: float | None,
    full_scale: float | None,
    bits: int | None,
    device: str | None,
    seed: int,
    title: str | None,
    html_file: Path | None,
    json_file: Path | None,
    **grid: str,
) -> None:
    """Compare methods on MEASUREMENT.

    Methods are the --decoders, and all combinations of --priors, --inits, --algorithms and --efforts. Prints seconds,
    residual and a score that needs no truth (higher is better: pixels of the measurement that were kept from a method
    are predicted); PSNR and SSIM where the truth is given. Exit code 1 if one of them fails; the others are reported
    all the same.
    """
    from pnp_sci import bench, io

    y = io.read_measurement(measurement, key)
    masks, unused = masks_for(measurement, masks_file, calibration, views, masks_key), bad_pixels(bad, bad_key)
    black_level, raw = 0.0, {} if calibration is None else {"calibration": calibration, "full_scale": full_scale}
    if calibration is not None:
        made, unused, full_scale, black_level = calibrated(calibration, unused, full_scale)
        y = made.correct(y)
    sensor = camera(noise, gain, full_scale, bits, black_level)
    several, each = y.ndim == 3, masks.ndim == 5
    truth = None if truth_file is None else true_video(truth_file, masks.shape[-4:], several, reference_key)
    if several or index is not None:
        index, count = index or 0, len(y)
        y, masks, unused = one_of(y, masks, unused, index)
        truth = None if truth is None else of_one(truth, count, index)
    files = measurement, masks_file or calibration or measurement, views, key, masks_key, index, bad, each
    result = bench.compare(
        y,
        masks,
        bench.grid(iterations=iterations, **{name: words(text) for name, text in grid.items()}),
        reference=truth,
        source=bench.Source(*files, bad_key=bad_key, **raw),
        progress=interactive(),
        noise=sensor,
        seed=seed,
        device=device,
        bad=unused,
    )
    for line in (*(f"Warning: {text}" for text in result.fit.warnings), *map(_line, result.trials)):
        click.echo(line)
    _write(result, json_file, html_file, title or f"{measurement.name}: methods compared")
    if failures := [f"{t.method.name}: {t.error}" for t in result.trials if t.error is not None]:
        raise click.ClickException("\n".join(failures))


def _write(result: Comparison, json_file: Path | None, html_file: Path | None, title: str) -> None:
    """Write the table and the report, where they are asked for."""
    from pnp_sci.formats.replacing import replacing

    if json_file is not None:
        with replacing(json_file) as temporary:
            temporary.write_text(result.as_json() + "\n", encoding="utf-8")
    if html_file is not None:
        result.save_html(html_file, title)
    if written := [str(file) for file in (html_file, json_file) if file is not None]:
        click.echo(f"Written: {', '.join(written)}")


def _line(trial: Trial) -> str:
    """A row of the table, and the remarks on the result below it."""
    if trial.result is None:
        return f"{trial.method.name:24s} failed"
    row = trial.row()
    truth = "".join(f"PSNR {p:.2f} dB, SSIM {s:.3f}; " for p, s in zip(trial.psnr, trial.ssim))
    line = (
        f"{row['name']:24s} {truth}score {row['score']:.2f} dB, residual {row['residual']:.4f}, "
        f"{row['seconds']:.2f} s, {row['iterations_done']} iterations: {row['status']}"
    )
    return "\n".join([line, *(f"  {remark}" for remark in row["remarks"])])
