"""Consecutive measurements of one video: one problem and one scene model for all, in windows that overlap."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from pnp_sci.scene.choose import choose_scene
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.sensing.sequence import SequenceOperator

OVERLAP = 1  # measurements on either side that a window sees beyond those that are kept of it
FEWEST = 2 * OVERLAP + 1  # measurements in a window
MOST = 2**25  # values of x in a window: about 3 GB with the prior "flow" or "video"

Each = TypeVar("Each", bound=Sequence)


@dataclass(frozen=True)
class Window:
    """Measurements that are solved together, and which of their videos are kept.

    Attributes
    ----------
    seen, kept : range
        Numbers of measurements; those in `seen` alone are solved again in the window beside.
    """

    seen: range
    kept: range

    def of_kept(self, each: Each) -> Each:
        """Of something for each measurement that the window sees, that of those that are kept."""
        begin = self.seen.start
        return each[self.kept.start - begin : self.kept.stop - begin]  # type: ignore[return-value]


def windows(count: int, most: int) -> Iterator[Window]:
    """The windows over `count` measurements, each of `most` of them at most, which keep every one once.

    >>> [(w.seen, w.kept) for w in windows(5, 4)]
    [(range(0, 4), range(0, 3)), (range(2, 5), range(3, 5))]
    """
    begin = 0
    while begin < count:
        first = max(begin - OVERLAP, 0)
        last = min(first + most, count)
        end = count if last == count else last - OVERLAP
        yield Window(range(first, last), range(begin, end))
        begin = end


def scene_of_all(scene: str | SceneModel, problems: Sequence[Problem], until: float, **options: Any) -> SceneModel:
    """The model that every measurement allows; simpler than the full one only if all of them demand the same.

    `until` and `options` are those of :func:`pnp_sci.scene.choose.choose_scene`.
    """
    middle = len(problems) // 2
    chosen = choose_scene(scene, problems[middle], until=until, **options)
    if chosen.complete or isinstance(scene, SceneModel):
        return chosen
    for n, problem in enumerate(problems):
        if time.perf_counter() > until:
            return full(problem.op, "there was no time to judge every measurement")
        other = chosen if n == middle else choose_scene(scene, problem, until=until, **options)
        if (other.views, other.still) != (chosen.views, chosen.still):
            return full(problem.op, f"measurement {n + 1} needs another model than measurement {middle + 1}")
    return chosen


def together(problems: Sequence[Problem]) -> Problem:
    """The problem of consecutive measurements, all in the same unit; that of a single one is itself."""
    if len(problems) == 1:
        return problems[0]

    def stacked(name: str) -> np.ndarray | None:
        pictures = [getattr(problem, name) for problem in problems]
        if all(picture is None for picture in pictures):
            return None
        return np.stack([np.zeros(problems[0].y.shape, bool) if p is None else p for p in pictures])

    noises = [problem.noise for problem in problems]
    if any(map(np.ndim, noises)) or len(set(noises)) > 1:  # type: ignore[arg-type]
        noise: Any = np.stack([np.broadcast_to(noise, problems[0].y.shape) for noise in noises])
    else:
        noise = noises[0]
    op = SequenceOperator([problem.op for problem in problems])
    y = np.stack([problem.y for problem in problems])
    estimated = all(problem.estimated for problem in problems)
    return Problem(op, y, problems[0].unit, noise, stacked("saturated"), stacked("bad"), estimated=estimated)


def alike(problems: Sequence[Problem], same_noise: bool) -> list[Problem]:
    """Problems of measurements by one camera: all in the median of their units, with the median of estimated noise."""
    unit = float(np.median([float(problem.unit) for problem in problems]))
    scaled = [replace(problem.scaled(unit / float(problem.unit)), unit=unit) for problem in problems]
    if not same_noise:
        return scaled
    noises: list[Any] = [problem.noise for problem in scaled]
    return [replace(problem, noise=float(np.median(noises))) for problem in scaled]
