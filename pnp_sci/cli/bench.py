"""The command ``pnp-sci bench``."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pnp_sci.cli.kinds import FIGURE, FOLDER, Command, Output
from pnp_sci.cli.options import grid_options, interactive, words
from pnp_sci.errors import SolverError

if TYPE_CHECKING:
    from pnp_sci.bench import Case, Method, Results, Row


def _numbers(kind: type) -> object:
    """A comma-separated list of numbers, as a callback of click."""

    def parse(context: click.Context, option: click.Parameter, text: str | None) -> list:
        try:
            return [kind(word) for word in text.split(",")] if text else [None]
        except ValueError:
            raise click.BadParameter(f"{text!r} came, numbers parted by commas were expected") from None

    return parse


def _place(context: click.Context, option: click.Parameter, path: Path | None) -> Any:
    """A file that can be written, or with ``--paper`` a folder, as a callback of click."""
    return None if path is None else (FOLDER if context.params["paper"] else Output()).convert(path, option, context)


@click.command(cls=Command)
@click.option("--cases", default="embedded", show_default=True, help="Scenes, files, dualview, singleview, real; a,b.")
@click.option("--masks", help="Of cases that are files: the file with the masks.  [default: the same]")
@click.option("--views", type=click.IntRange(min=1), help="Of files: how many views share the planes of the masks.")
@click.option("--key", help="Of files: name of the measurement, where it cannot be told.")
@click.option("--masks-key", help="Of files: name of the masks, where it cannot be told.")
@click.option("--reference-key", help="Of files: name of the true video.  [default: x]")
@click.option("--noise", callback=_numbers(float), help="Measure anew with noise, in parts of the largest y; a,b.")
@click.option("--frames", callback=_numbers(int), help="Measure anew the first frames of each view; a,b.")
@click.option("--priors", default="tv", show_default=True, help="Comma-separated; a+b joins two; may be empty.")
@grid_options
@click.option("--repeat", default=1, show_default=True, type=click.IntRange(min=1), help="Timings of each row.")
@click.option("--paper", is_flag=True, is_eager=True, help="The paper's tables, ours beside theirs; see docs/results.")
@click.option(
    "--out", type=Output(".json"), help="Keep rows in this .json, and a .csv beside it; what is there is not redone."
)
@click.option(
    "--markdown",
    type=click.Path(path_type=Path),
    callback=_place,
    help="Write the table; with --paper a folder of tables.",
)
@click.option("--curves", type=FIGURE, help="Draw PSNR against seconds: .svg, .png or .pdf.")
def bench(
    cases: str,
    noise: list[float | None],
    frames: list[int | None],
    priors: str,
    inits: str,
    algorithms: str,
    efforts: str,
    decoders: str,
    iterations: int | None,
    repeat: int,
    paper: bool,
    out: Path | None,
    markdown: Path | None,
    curves: Path | None,
    **of_files: Any,
) -> None:
    """Measure methods on cases: PSNR, SSIM, seconds, memory.

    Each row is measured in a process of its own. Methods are the --decoders, and all combinations of --priors, --inits,
    --algorithms and --efforts.
    """
    from pnp_sci import bench as table
    from pnp_sci.bench import paper as tables
    from pnp_sci.formats.replacing import replacing, same_file
    from pnp_sci.pipeline.progress import bar

    if out is not None and markdown is not None and same_file(out.with_suffix(".csv"), markdown):
        raise click.UsageError(f"--markdown {markdown} is the table beside --out {out}: it would be lost")
    if paper:
        pairs = tables.plan()
    else:
        methods = table.grid(
            words(priors), words(inits), words(algorithms), words(efforts), iterations, words(decoders)
        )
        pairs = [(case, method) for case in table.expand(words(cases), noise, frames, **of_files) for method in methods]
        if not pairs:
            raise click.UsageError("nothing to measure: --cases, and --priors or --decoders were expected")
    results = table.Results(out) if out is not None else None
    rows, failures = _measured(bar(pairs, desc="bench", shown=interactive()), results, repeat)
    if paper:
        written = tables.write(markdown or Path("docs/results"), rows)
        click.echo(f"Written: {', '.join(map(str, written))}")
    else:
        click.echo(table.as_markdown(rows))
        if markdown is not None:
            with replacing(markdown) as temporary:
                temporary.write_text(table.as_markdown(rows) + "\n", "utf-8", "backslashreplace")
    if curves is not None:
        found = table.curves(rows)
        table.draw(curves, found)
        click.echo(table.front_table(found))
    if failures:
        raise click.ClickException("\n".join(failures))


def _measured(
    pairs: Iterable[tuple[Case, Method]], results: Results | None, repeat: int
) -> tuple[list[Row], list[str]]:
    """Rows of cases and methods, those kept in `results` or new ones, and what went wrong."""
    from pnp_sci.bench import run

    rows, failures = [], []
    for case, method in pairs:
        row = results.find(case, method, repeat) if results else None
        if row is None:
            try:
                row = run(case, method, repeat)
            except SolverError as error:
                failures.append(str(error))
                continue
            if results:
                results.add(row)
        rows.append(row)
    return rows, failures
