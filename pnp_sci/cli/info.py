"""The commands ``pnp-sci info``, ``priors`` and ``recommend``: what is in a file, installed, or advised."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pnp_sci.cli.kinds import FILE, POSITIVE
from pnp_sci.errors import FormatError, UnknownPluginError

if TYPE_CHECKING:
    import numpy as np


@click.command()
@click.argument("file", type=FILE)
@click.option("--views", type=click.IntRange(min=1), help="How many views share the planes of the masks.")
def info(file: Path, views: int | None) -> None:
    """Say what is in FILE.

    Its arrays, how well its masks code the frames, and how its result was obtained.
    """
    from pnp_sci import io
    from pnp_sci.formats.zarr import is_store
    from pnp_sci.masks import condition

    if is_store(file):
        _print_store(file)
        return
    entries = io.describe(file)
    if {"x", "history"} <= {entry.key for entry in entries}:
        _print_result(file)
        return
    for entry in entries:
        click.echo(f"{entry.key:12s} {' x '.join(map(str, entry.shape)):22s} {entry.dtype:8s} {entry.meaning}")
    masks = [io.read_masks(file, views, entry.key) for entry in entries if entry.meaning.startswith("masks")]
    for planes in (own for each in masks for own in each.reshape(-1, *each.shape[-4:])):
        click.echo(f"\n{condition(planes)}")
    measurements = [entry.key for entry in entries if entry.meaning.startswith("measurement")]
    if len(masks) == len(measurements) == 1:
        _print_fit(io.read_measurement(file, measurements[0]), masks[0])


def _print_store(folder: Path) -> None:
    """What :func:`pnp_sci.reconstruct` has written, or a result."""
    from pnp_sci import io
    from pnp_sci.fleet.reconstruction import Reconstruction
    from pnp_sci.formats.replacing import is_own_store

    if is_own_store(folder):
        _print_result(folder)
        return
    try:
        reconstruction = Reconstruction(folder)
    except FormatError:
        io.describe(folder)  # of other software: the error says what reads it
        raise
    click.echo(f"{reconstruction!r}\n{json.dumps(reconstruction.settings, indent=2)}")


def _print_result(file: Path) -> None:
    from pnp_sci.results.result import Result

    result = Result.load(file)
    click.echo(f"{result!r}\n{json.dumps(result.settings, indent=2)}")


def _print_fit(y: np.ndarray, masks: np.ndarray) -> None:
    """How each measurement fits the masks, if they are as large as it."""
    from pnp_sci.camera.check import check_fit

    if y.shape[-2:] != masks.shape[-2:]:
        return
    fits = check_fit(y, masks)
    for n, fit in enumerate(fits if isinstance(fits, list) else [fits], 1):
        click.echo(f"\n{f'Measurement {n}: ' if y.ndim == 3 else ''}{fit}")


@click.command()
def priors() -> None:
    """List the priors and decoders that are installed."""
    from pnp_sci.plugins import registry

    for kind, title in {"priors": "Priors", "decoders": "Decoders, also for --init"}.items():
        plugins = registry.available(kind)
        if plugins:
            click.echo(f"{title}:")
        for name in plugins:
            click.echo(f"  {name:12s} {_summary(kind, name)}")


@click.command()
@click.argument("budget_seconds", type=POSITIVE)
@click.option("--like", default="dualview", show_default=True, help="dualview, singleview, a scene, or VxBxHxW.")
@click.option("--results", type=FILE, help="File written by `pnp-sci bench`.  [default: what comes with the package]")
def recommend(budget_seconds: float, like: str, results: Path | None) -> None:
    """Name the best method that takes at most BUDGET_SECONDS here.

    The seconds are those of one measurement on this machine.
    """
    from pnp_sci.advice.recommend import recommend as choose

    sides = like.split("x")
    size = tuple(map(int, sides)) if len(sides) == 4 and all(side.isdigit() for side in sides) else like
    advice = choose(budget_seconds, size, results)
    click.echo(f"{advice.python}\n{advice.psnr:.2f} dB on {', '.join(advice.cases)}; {advice.seconds:.2g} s here")


def _summary(kind: str, name: str) -> str:
    """The first line of a plugin's docstring, or why it cannot be loaded."""
    from pnp_sci.plugins.registry import load

    try:
        line = (load(kind, name).__doc__ or "").strip().partition("\n")[0]
    except UnknownPluginError as error:
        return f"({error})"
    return re.sub(r":\w+:`~?([^`]+)`", r"\1", line).replace("``", "")
