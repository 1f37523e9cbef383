"""Anytime curves: PSNR against seconds during the iterations, and their Pareto front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from pnp_sci._optional import needed_for
from pnp_sci.advice.recommend import Moment, course
from pnp_sci.bench.methods import Method
from pnp_sci.bench.runner import Row
from pnp_sci.errors import InputError
from pnp_sci.formats.replacing import replacing


def curves(rows: Sequence[Row]) -> dict[Method, list[Moment]]:
    """Mean PSNR over the cases against mean seconds, for each method that was measured on all cases with a truth.

    Raises
    ------
    InputError
        If there is no such method.
    """
    known = [row for row in rows if row.psnr]
    cases = {row.case for row in known}
    by_method: dict[Method, list[Row]] = {}
    for row in known:
        by_method.setdefault(row.method, []).append(row)
    complete = {method: own for method, own in by_method.items() if {row.case for row in own} == cases}
    if not complete:
        raise InputError("rows have no method that was scored on all cases: one at least was expected")
    return {method: course([asdict(row) for row in own]) for method, own in complete.items()}


def front(all_curves: dict[Method, list[Moment]]) -> list[tuple[Moment, Method]]:
    """The Pareto front: moments in order of seconds, each with a larger PSNR than all earlier ones."""
    best: list[tuple[Moment, Method]] = []
    moments = ((moment, method) for method, own in all_curves.items() for moment in own)
    for moment, method in sorted(moments, key=lambda pair: (pair[0].seconds, -pair[0].psnr)):
        if not best or moment.psnr > best[-1][0].psnr:
            best.append((moment, method))
    return best


def draw(path: str | Path, all_curves: dict[Method, list[Moment]]) -> None:
    """Write a plot of the curves and their front, in the format of the path's suffix (.svg, .png, .pdf)."""
    with needed_for("a figure", "plot"):
        from matplotlib.figure import Figure
    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.subplots()
    for method, own in all_curves.items():
        axes.plot(
            [m.seconds for m in own], [m.psnr for m in own], label=method.name, marker="o" if len(own) == 1 else None
        )
    best = [moment for moment, _ in front(all_curves)]
    axes.step(
        [m.seconds for m in best], [m.psnr for m in best], where="post", color="0.8", linewidth=6, zorder=0,
        label="Pareto front",
    )  # fmt: skip
    axes.set(xscale="log", xlabel="seconds a measurement", ylabel="PSNR (dB), mean over the cases")
    axes.grid(color="0.9")
    axes.legend(frameon=False)
    with replacing(Path(path)) as temporary:
        figure.savefig(temporary)


def front_table(all_curves: dict[Method, list[Moment]], seconds: Sequence[float] = (0.1, 0.3, 1, 3, 5, 10, 30)) -> str:
    """The best method within each number of seconds, as a Markdown table."""
    best = front(all_curves)
    lines = ["| within | PSNR (dB) | method | iterations |", "|" + " --- |" * 4]
    for limit in seconds:
        if within := [(moment, method) for moment, method in best if moment.seconds <= limit]:
            moment, method = within[-1]
            lines.append(f"| {limit:g} s | {moment.psnr:.2f} | {method.name} | {moment.iteration or '-'} |")
    return "\n".join(lines)
