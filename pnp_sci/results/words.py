"""What texts of a result have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from pnp_sci.formats.plain import some
from pnp_sci.results.history import History, Record


def counted(numbers: Sequence[int]) -> str:
    """``[0, 2]`` -> ``"1, 3"``; ten at most."""
    return some([str(n + 1) for n in numbers], 10)


def in_words(plan: dict[str, Any]) -> str:
    """A plan as :meth:`pnp_sci.solvers.plan.Plan.describe` gives it, in a line."""
    ends = [*(turn["from"] for turn in plan["serves"][1:]), plan["iterations"]]
    turns = [f"{turn['name']} to iteration {end} at most" for turn, end in zip(plan["serves"], ends)]
    first, last = plan["sigma"]
    sigma = f"sigma {first:.3g}" if first == last else f"sigma falling from {first:.3g} to {last:.3g}"
    return f"{plan['algorithm']}: {', then '.join(turns)}; {sigma}, rho {plan['rho']:.3g}"


def size(videos: np.ndarray, several: bool) -> str:
    """What there is of videos (N, V, B, H, W) or (N, V, B, H, W, 3).

    >>> size(np.ones((4, 1, 3, 8, 6, 3)), several=True)
    '4 videos of 1 view x 3 frames of 8 x 6 in colour'
    """
    count, views, frames, rows, columns, *colours = videos.shape
    of_all, colour = f"{count} video{'s' * (count != 1)} of " * several, " in colour" * bool(colours)
    return f"{of_all}{views} view{'s' * (views != 1)} x {frames} frames of {rows} x {columns}{colour}"


def last_records(history: History) -> list[Record]:
    """The last record of each measurement, or of each window of a sequence."""
    return list({record.measurement: record for record in history}.values())


def effort(history: History) -> str:
    """Iterations and seconds of all measurements.

    >>> effort(History([Record(7, 0.5, 0.01, 0.0)]))
    '7 iterations in 0.5 s'
    """
    last = last_records(history)
    iterations = sum(record.iteration for record in last)
    seconds = sum(record.seconds for record in last)
    return f"{iterations} iteration{'s' * (iterations != 1)} in {seconds:.2g} s"


def scores(history: History, uncertainty: np.ndarray | None) -> str:
    """Means over the measurements, as far as they are known; "" if none is.

    >>> scores(History([Record(7, 0.5, 0.01, 0.0, psnr=30.0)]), None)
    'residual 0.01, PSNR 30.00 dB'
    """
    units = {"residual": " {:.2g}", "psnr": " {:.2f} dB", "ssim": " {:.3f}"}
    last, texts = last_records(history), []
    for name, unit in units.items():
        values = [value for record in last if (value := getattr(record, name)) is not None]
        if values:
            texts.append((name if name == "residual" else name.upper()) + unit.format(np.mean(values)))
    if uncertainty is not None and np.isfinite(uncertainty).any():
        texts.append(f"predicted error {np.sqrt(np.nanmean(np.square(uncertainty, dtype=np.float64))):.2g}")
    return ", ".join(texts)


def plans(settings: Mapping[str, Any]) -> list[str]:
    """How it was obtained: a line for each measurement, or for each window of a sequence."""
    found, of = settings.get("plan", []), "window" if settings.get("sequence", 1) > 1 else "measurement"
    return [(f"{of} {n}: " if len(found) > 1 else "") + in_words(plan) for n, plan in enumerate(found, 1)]
