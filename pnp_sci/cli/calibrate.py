"""The command ``pnp-sci calibrate``."""

from __future__ import annotations

from pathlib import Path

import click

from pnp_sci.cli.kinds import FIGURE, FILE, POSITIVE, Command, Output
from pnp_sci.cli.outputs import ARRAYS
from pnp_sci.errors import InputError


@click.command(cls=Command)
@click.argument("patterns", nargs=-1, required=True, type=FILE)
@click.option("--dark", type=FILE, help="Pictures without light.  [default: none were taken]")
@click.option("--white", type=FILE, help="Pictures with all elements open.  [default: none were taken]")
@click.option("--repeats", default=1, show_default=True, type=click.IntRange(min=1), help="Pictures of each pattern.")
@click.option("--crop", nargs=4, type=int, help="Top, left, rows and columns of the part that is kept.")
@click.option("--full-scale", type=POSITIVE, help="The camera's largest value: pixels there are saturated.")
@click.option("--out", type=Output(*ARRAYS), default=Path("calibration.npz"), show_default=True, help=".npz, .h5, .mat")
@click.option("--report", type=FIGURE, help="Draw dark frame, masks and bad pixels.")
def calibrate(
    patterns: tuple[Path, ...],
    dark: Path | None,
    white: Path | None,
    repeats: int,
    crop: tuple[int, int, int, int] | None,
    full_scale: float | None,
    out: Path,
    report: Path | None,
) -> None:
    """Make masks from raw PATTERNS, a file for each view.

    A folder of pictures counts as a file. Repeats of a pattern follow one another. Prints how good the masks are.
    """
    import numpy as np

    from pnp_sci import io
    from pnp_sci.camera.calibrate import calibrate as make
    from pnp_sci.formats.replacing import replacing

    stacks = [io.read(file) for file in patterns]
    for file, stack in zip(patterns, stacks):
        if stack.ndim != 3:
            came = f"{file} holds an array {stack.shape}"
            raise InputError(f"{came}: (pictures, rows, columns), at least a picture of each pattern, was expected")
        if len(stack) % repeats or stack.shape != stacks[0].shape:
            came = f"{file} has {len(stack)} pictures of {stack.shape[1]} x {stack.shape[2]}"
            raise InputError(f"{came}: a multiple of {repeats} of one size and number for all views was expected")
    raw = np.stack([stack.reshape(-1, repeats, *stack.shape[1:]) for stack in stacks])
    black, lit = (None if file is None else io.read(file) for file in (dark, white))
    made = make(black, lit, raw, crop=crop, full_scale=full_scale)
    made.save(out)
    click.echo(str(made))
    if report is not None:
        with replacing(report) as temporary:
            made.plot().savefig(temporary)
    click.echo(f"\nWritten: {', '.join(str(file) for file in (out, report) if file)}")
