"""The Pareto front of quality against seconds, and its SVG chart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

WIDTH, HEIGHT = 480, 320  # size of the drawing in SVG units
LEFT, RIGHT, TOP, BOTTOM = 52, 16, 14, 44  # margins in SVG units
TEXT = 14  # height of a letter in SVG units; its mean width is about half
ASIDE = ((7, -6, "start"), (7, 17, "start"), (-7, -6, "end"), (-7, 17, "end"))  # offsets and anchors of a label


@dataclass(frozen=True)
class Point:
    """A method: seconds > 0, quality in dB."""

    name: str
    seconds: float
    quality: float


def front(points: Sequence[Point]) -> list[bool]:
    """Whether each point is on the Pareto front: no other is better in one respect and at least as good in the other.

    >>> front([Point("tv", 1, 24), Point("flow", 6, 26), Point("wavelet", 3, 23)])
    [True, True, False]
    """

    def beats(a: Point, b: Point) -> bool:
        no_worse = a.seconds <= b.seconds and a.quality >= b.quality
        return no_worse and (a.seconds, a.quality) != (b.seconds, b.quality)

    return [not any(beats(other, point) for other in points) for point in points]


def chart(points: Sequence[Point]) -> dict[str, Any]:
    """Coordinates of the chart for the template: ticks, points with their labels, and the line of the front.

    The axis of seconds is logarithmic. Labels do not overlap points or other labels; without room they are left out.
    """
    best = front(points)
    seconds = _seconds_ticks([p.seconds for p in points])
    levels = _quality_ticks([p.quality for p in points])
    low, high = math.log(seconds[0]), math.log(seconds[-1])

    def across(value: float) -> float:
        return LEFT + (WIDTH - LEFT - RIGHT) * (math.log(value) - low) / (high - low)

    def down(value: float) -> float:
        return TOP + (HEIGHT - TOP - BOTTOM) * (levels[-1] - value) / (levels[-1] - levels[0])

    places = [(across(p.seconds), down(p.quality)) for p in points]
    corners = sorted(place for place, is_best in zip(places, best) if is_best)
    steps = [f"M{corners[0][0]:.1f} {corners[0][1]:.1f}", *(f"H{x:.1f}V{y:.1f}" for x, y in corners[1:])]
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "frame": (LEFT, TOP, WIDTH - RIGHT, HEIGHT - BOTTOM),
        "seconds": [(across(t), f"{t:g}") for t in seconds],
        "levels": [(down(t), f"{t:g}") for t in levels],
        "points": [
            {"point": point, "x": x, "y": y, "best": is_best, "label": label}
            for point, (x, y), is_best, label in zip(points, places, best, _labels(points, places))
        ],
        "front": "".join(steps),
    }


def _seconds_ticks(values: Sequence[float]) -> list[float]:
    """Ticks that enclose the values: 1, 2 and 5 times powers of ten.

    >>> _seconds_ticks([0.3, 6])
    [0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
    """
    decades = range(math.floor(math.log10(min(values))) - 1, math.ceil(math.log10(max(values))) + 1)
    ticks = [float(f"{m}e{d}") for d in decades for m in (1, 2, 5)]
    first = max(i for i, tick in enumerate(ticks) if tick < min(values))
    last = min(i for i, tick in enumerate(ticks) if tick > max(values))
    chosen = ticks[first : last + 1]
    return chosen if len(chosen) <= 8 else [t for t in chosen if f"{t:e}"[0] == "1" or t in (chosen[0], chosen[-1])]


def _quality_ticks(values: Sequence[float]) -> list[float]:
    """Ticks that enclose the values: equidistant round numbers.

    >>> _quality_ticks([21.3, 25.9])
    [21, 22, 23, 24, 25, 26]
    """
    span = max(max(values) - min(values), 0.5)
    step = next(s for s in (m * 10**e for e in range(-2, 9) for m in (1, 2, 5)) if span / s <= 6)
    first, last = math.floor(min(values) / step), math.ceil(max(values) / step)
    return [round(k * step, 6) for k in range(first, max(last, first + 1) + 1)]


def _labels(points: Sequence[Point], places: Sequence[tuple[float, float]]) -> list[dict[str, Any] | None]:
    """Position of the label of each point (x, y, anchor), or None without room."""
    taken = [(x - 6, y - 6, x + 6, y + 6) for x, y in places]
    labels: list[dict[str, Any] | None] = []
    for point, (x, y) in zip(points, places):
        width = len(point.name) * TEXT * 0.52
        for dx, dy, anchor in ASIDE:
            left = x + dx - width * (anchor == "end")
            box = (left, y + dy - TEXT, left + width, y + dy + 3)
            inside = box[0] > LEFT and box[1] > 0 and box[2] < WIDTH and box[3] < HEIGHT - BOTTOM
            if inside and not any(_overlap(box, other) for other in taken):
                taken.append(box)
                labels.append({"x": x + dx, "y": y + dy, "anchor": anchor})
                break
        else:
            labels.append(None)
    return labels


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
