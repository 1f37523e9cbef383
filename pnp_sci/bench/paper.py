"""The tables of the OFaNet paper with our results, as Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np

from pnp_sci.bench.cases import Case
from pnp_sci.bench.methods import Method
from pnp_sci.bench.published import ABLATION, AVERAGE, DUAL_VIEW, FRAMES, NOISE, Table
from pnp_sci.bench.published import SINGLE_VIEW as SINGLE
from pnp_sci.bench.runner import Row
from pnp_sci.datasets import DUAL_VIEW_PAIRS, SINGLE_VIEW
from pnp_sci.errors import DataUnavailableError
from pnp_sci.formats.replacing import replacing

OURS = (
    Method("tv"),
    Method("flow"),
    Method("tv+ffdnet"),
    Method("desci"),
    Method("video"),  # "auto" with the default effort
    Method("video", effort="best"),  # "auto" with effort="best"
    Method(None, init="ofanet-fast"),
    Method(None, init="ofanet"),
    Method(None, init="unet"),
    Method(None, init="admm-net"),
    Method(None, init="birnat"),
)
OF_ANY_SIZE = tuple(method for method in OURS if method.init not in ("unet", "admm-net", "birnat"))
OFANET = tuple(method for method in OURS if method.init.startswith("ofanet"))
WITH_NOISE = tuple(method for method in OURS if method.prior != "tv+ffdnet")
STARTS = ("adjoint", *(method.init for method in OFANET))
WARM = tuple(Method(prior, init=init) for prior in ("tv", "flow", "video") for init in STARTS)
AFTER = (5, 10, 20, 50)  # iterations: columns of the table of warm starts
AS_GOOD = 0.05  # dB: tolerance of "as good as the end of the cold start"
NOISES = (0.01, 0.05, 0.1, 0.2)
ONE_VIEW = (*SINGLE_VIEW, "kobe")
OTHERS = "Our averages are over the videos of the available pairs, {here}; those of the paper are over all twelve.\n"
LEGEND = """\
PSNR in dB / SSIM, and seconds for one measurement.
Plain columns: the OFaNet paper (arXiv:2109.05287, {source}); its networks ran on an NVIDIA RTX 8000 GPU.
**Bold columns: pnp-sci**, measured with its defaults on two CPU cores by `pnp-sci bench --paper`.
A dash: not measured, because the scene or the weights are not available.
"""
WARM_START = """\
# Warm starts

Mean PSNR in dB over the videos of {pairs}, two CPU cores, by `pnp-sci bench --paper`.
"As good after": mean seconds until the PSNR is within {under} dB of the final PSNR of the start `adjoint`; "never" if
that does not happen for all pairs.

"""
Measured = dict[tuple[Case, Method], Row]
Scores = tuple[float, float]
Columns = dict[Method, dict[str | float, Scores]]


def plan() -> list[tuple[Case, Method]]:
    """All cases and methods of the tables, for the available scenes."""
    pairs, singles = (list(filter(_is_at_hand, names)) for names in (DUAL_VIEW_PAIRS, ONE_VIEW))
    cases = [(Case(pair), method) for method in dict.fromkeys((*OURS, *WARM)) for pair in pairs]
    cases += [(Case(name), method) for method in OURS for name in singles]
    cases += [(Case(pair, frames=6), method) for method in OF_ANY_SIZE for pair in pairs]
    return cases + [(Case(pair, noise=noise), method) for noise in NOISES for method in WITH_NOISE for pair in pairs]


def _is_at_hand(scene: str) -> bool:
    try:
        Case(scene).load()
    except DataUnavailableError:
        return False
    return True


def write(folder: Path, rows: Sequence[Row]) -> list[Path]:
    """Write one Markdown file per table to `folder`; missing rows are shown as dashes. Returns the paths."""
    folder.mkdir(parents=True, exist_ok=True)
    measured = {(row.case, row.method): row for row in rows}
    pages = {"dual-view": dual_view, "frames": frames, "noise": noise, "single-view": single_view, "ablation": ablation}
    pages["warm-start"] = warm_start
    paths = []
    for name, page in pages.items():
        paths.append(folder / f"{name}.md")
        with replacing(paths[-1]) as temporary:
            temporary.write_text(page(measured), encoding="utf-8")
    return paths


def dual_view(measured: Measured) -> str:
    """Table 2: each video, then the averages over the available videos."""
    columns = {method: _by_video(measured, DUAL_VIEW_PAIRS, method) for method in OURS}
    seconds = {method: _seconds(measured, DUAL_VIEW_PAIRS, method) for method in OURS}
    return _page(DUAL_VIEW, columns, seconds, "video")


def single_view(measured: Measured) -> str:
    """Table 6: single view."""
    columns: Columns = {method: {} for method in OURS}
    for name, method in product(ONE_VIEW, OURS):
        if row := measured.get((Case(name), method)):
            columns[method][name] = _scores(row)
    return _page(SINGLE, columns, {method: _seconds(measured, ONE_VIEW, method) for method in OURS}, "video")


def frames(measured: Measured) -> str:
    """Table 4: averages by number of frames, the paper's over twelve videos and ours over the available ones."""
    columns = {m: _known({6.0: _mean(measured, m, frames=6), 10.0: _mean(measured, m)}) for m in OURS}
    return _page(FRAMES, columns, {}, "frames", OTHERS.format(here=", ".join(_pairs(measured))))


def noise(measured: Measured) -> str:
    """Table 5: averages by noise, over the same videos as in :func:`frames`."""
    columns = {m: _known({n: _mean(measured, m, noise=n or None) for n in (0.0, *NOISES)}) for m in WITH_NOISE}
    return _page(NOISE, columns, {}, "noise", OTHERS.format(here=", ".join(_pairs(measured))))


def ablation(measured: Measured) -> str:
    """Table 3: the variants of OFaNet, of which we have weights for DA&DNS ("w/o RN") and OFaNet."""
    columns = {method: _by_video(measured, DUAL_VIEW_PAIRS, method) for method in OFANET}
    seconds = {method: _seconds(measured, DUAL_VIEW_PAIRS, method) for method in OFANET}
    return _page(ABLATION, columns, seconds, "video")


def warm_start(measured: Measured) -> str:
    """Decoders as the initial estimate of a solver (not a table of the paper)."""
    heads = ["prior, first estimate", *(f"after {n}" for n in AFTER), "end", "seconds", "as good after"]
    lines = [f"| {' | '.join(heads)} |", "|" + " --- |" * len(heads)]
    pairs = _pairs(measured)
    for method in WARM:
        rows = [measured.get((Case(pair), method)) for pair in pairs]
        cold = [measured.get((Case(pair), replace(method, init="adjoint"))) for pair in pairs]
        known = [(row, other) for row, other in zip(rows, cold) if row and other]
        cells = ["-"] * (len(heads) - 1)
        if known and len(known) == len(rows):
            values = np.mean([[*(_after(row, n) for n in AFTER), np.mean(row.psnr)] for row, _ in known], 0)
            seconds = np.mean([[row.course[-1].seconds, _as_good(row, other)] for row, other in known], 0)
            cells = [f"{v:.2f}" for v in values] + [f"{s:.3g} s" if np.isfinite(s) else "never" for s in seconds]
        lines.append(f"| `{method.prior}` from `{method.init}` | {' | '.join(cells)} |")
    return WARM_START.format(pairs=", ".join(pairs), under=AS_GOOD) + "\n".join(lines) + "\n"


def _after(row: Row, iterations: int) -> float:
    """PSNR in dB after this number of iterations, or the last one if there are fewer."""
    return next(p.psnr for p in reversed(row.course) if p.iteration <= iterations)  # type: ignore[return-value]


def _as_good(row: Row, cold: Row) -> float:
    """Seconds until a row is within AS_GOOD of the final PSNR of the cold start; inf if it never is."""
    goal = float(np.mean(cold.psnr)) - AS_GOOD
    return next((point.seconds for point in row.course if point.psnr is not None and point.psnr >= goal), np.inf)


def _scores(row: Row) -> Scores:
    return float(np.mean(row.psnr)), float(np.mean(row.ssim))


def _by_video(measured: Measured, pairs: Sequence[str], method: Method) -> dict[str | float, Scores]:
    videos: dict[str | float, Scores] = {}
    for pair in pairs:
        if row := measured.get((Case(pair), method)):
            videos |= {video: (psnr, ssim) for video, psnr, ssim in zip(pair.split("_"), row.psnr, row.ssim)}
    return videos


def _known(cells: dict[float, Scores | None]) -> dict[str | float, Scores]:
    return {row: scores for row, scores in cells.items() if scores is not None}


def _mean(measured: Measured, method: Method, noise: float | None = None, frames: int | None = None) -> Scores | None:
    """Mean over the available pairs; None if one of them was not measured."""
    rows = [measured.get((Case(pair, noise, frames), method)) for pair in _pairs(measured)]
    known = [_scores(row) for row in rows if row is not None]
    return _average(known) if known and len(known) == len(rows) else None


def _pairs(measured: Measured) -> list[str]:
    """The available pairs: those with a row."""
    return [pair for pair in DUAL_VIEW_PAIRS if any(case.scene == pair for case, _ in measured)]


def _average(scores: Sequence[Sequence[float]]) -> Scores:
    psnr, ssim = np.mean(scores, axis=0)
    return float(psnr), float(ssim)


def _seconds(measured: Measured, names: Sequence[str], method: Method) -> float | None:
    rows = [measured[Case(name), method] for name in names if (Case(name), method) in measured]
    return float(np.median([np.median(row.seconds) for row in rows])) if rows else None


def _page(table: Table, columns: Columns, seconds: dict[Method, float | None], first: str, remark: str = "") -> str:
    """A page with the paper's columns and then ours in bold; the last lines are averages over the available videos."""
    heads = [*table.columns, *(f"**{method.name}**" for method in columns)]
    lines = [f"| {first} | {' | '.join(heads)} |", "|" + " --- |" * (len(heads) + 1)]
    for row in table.rows:
        label = "average, all of the paper's" if row == AVERAGE else f"{row:g}" if isinstance(row, float) else row
        lines.append(_line(label, [*table.values[row].values(), *(own.get(row) for own in columns.values())]))
    if AVERAGE in table.rows:
        if here := [row for row in table.rows if any(row in own for own in columns.values())]:
            theirs = [_average([table.values[row][name][:2] for row in here]) for name in table.columns]
            ours = [_average([own[r] for r in here]) if own.keys() >= set(here) else None for own in columns.values()]
            lines.append(_line(f"average of {', '.join(map(str, here))}", [*theirs, *ours]))
        times = [*(table.values[AVERAGE][name].seconds for name in table.columns), *map(seconds.get, columns)]
        lines.append(f"| seconds | {' | '.join('-' if s is None else f'{s:.3g}' for s in times)} |")
    return f"# {table.title}\n\n{LEGEND.format(source=table.source)}{remark}\n" + "\n".join(lines) + "\n"


def _line(label: object, cells: Sequence) -> str:
    texts = ["-" if cell is None else f"{cell[0]:.2f} / {cell[1]:.2f}" for cell in cells]
    return f"| {label} | {' | '.join(texts)} |"
