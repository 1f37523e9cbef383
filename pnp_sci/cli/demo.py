"""The command ``pnp-sci demo``."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci.cli.kinds import FOLDER
from pnp_sci.cli.options import interactive
from pnp_sci.cli.outputs import White, check_white, named, print_scores
from pnp_sci.errors import MissingExtraError

if TYPE_CHECKING:
    from pnp_sci.datasets import Scene
    from pnp_sci.results.result import Result

FPS = 5  # slow enough to compare


@click.command()
@click.option("--prior", default="flow", show_default=True, help="One of `pnp-sci priors`, or a+b.")
@click.option("--out", type=FOLDER, default=Path(), help="Folder for demo.png and demo.mp4.  [default: this one]")
@click.option("--size", default=256, show_default=True, help="Rows and columns of the scene.")
@click.option("--white", type=White(), help="White of the pictures, or one a view: 1,0.2; view: each its own.")
def demo(prior: str, out: Path, size: int, white: Any) -> None:
    """Recover two videos from one picture, and show them.

    The scene comes with the package. Prints PSNR, SSIM and seconds, and writes demo.png and demo.mp4: measurement,
    result and truth side by side.
    """
    from pnp_sci.api import solve
    from pnp_sci.datasets import embedded_scene

    scene = embedded_scene(size)
    check_white(white, len(scene.masks))
    click.echo(f"{scene!r}, all in one picture. A new installation first compiles for a minute or two.")
    start = time.perf_counter()
    solve(scene.y, scene.masks, prior, progress=interactive())
    first = time.perf_counter() - start
    result = solve(scene.y, scene.masks, prior)
    print_scores(result.x, scene.truth)
    seconds, iterations = result.settings["seconds"], result.history[-1].iteration
    click.echo(
        f"Prior {result.settings['prior']}: {seconds:.2f} seconds for {iterations} iterations: {result.status.value}"
    )
    click.echo(f"({first:.2f} seconds the first time, when kernels are loaded and, in a new installation, compiled.)")
    out.mkdir(parents=True, exist_ok=True)
    written = []
    for file, show in ((out / "demo.png", _picture), (out / "demo.mp4", _film)):
        try:
            show(file, scene, result, white)
        except MissingExtraError as missing:
            click.echo(f"No {file}: {missing}")
        else:
            written.append(named(file, FPS))
    if written:
        click.echo(f"Written: {', '.join(written)}")
    result.raise_for_status()


def _picture(file: Path, scene: Scene, result: Result, white: Any) -> None:
    """The measurement, and of each view the first and the last frame beside the truth, with its PSNR."""
    from pnp_sci.metrics import psnr
    from pnp_sci.plot import plot_recovery

    captions = [f"{value:.2f} dB" for value in psnr(result.x, scene.truth)]
    plot_recovery(scene.y, result.x, scene.truth, captions=captions, white=white).savefig(file, dpi=110)


def _film(file: Path, scene: Scene, result: Result, white: Any) -> None:
    """In a row for each view: the measurement, the result and the truth."""
    import numpy as np

    from pnp_sci.formats.brightness import whites
    from pnp_sci.io import write_video

    still = np.broadcast_to(scene.y / scene.y.max(), result.x.shape)
    levels = whites(white, result.x[None], 1.0)[:, None, None, None]
    rows = np.concatenate((still, result.x / levels, np.asarray(scene.truth) / levels), axis=-1)
    write_video(file, np.concatenate(list(rows), axis=-2), FPS)
