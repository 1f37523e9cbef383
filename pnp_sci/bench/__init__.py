"""Measure methods: on known scenes, each in a process of its own, or all on one measurement, with or without truth."""

from .cases import expand, load
from .comparison import Comparison, Trial, compare
from .held_back import filled_start, held_back_score
from .methods import Method, Source, grid
from .runner import Row, as_json, as_markdown, run

__all__ = [
    "Comparison",
    "Method",
    "Row",
    "Source",
    "Trial",
    "as_json",
    "as_markdown",
    "compare",
    "expand",
    "filled_start",
    "grid",
    "held_back_score",
    "load",
    "run",
]
