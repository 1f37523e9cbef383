"""Measure methods: on known scenes, each in a process of its own, or all on one measurement, with or without truth."""

from .cases import Case, expand
from .comparison import Comparison, Trial, compare
from .curves import curves, draw, front, front_table
from .held_back import filled_start, held_back_score
from .methods import Method, Source, grid
from .results import Results, read
from .runner import Checkpoint, Row, as_markdown, run

__all__ = [
    "Case",
    "Checkpoint",
    "Comparison",
    "Method",
    "Results",
    "Row",
    "Source",
    "Trial",
    "as_markdown",
    "compare",
    "curves",
    "draw",
    "expand",
    "filled_start",
    "front",
    "front_table",
    "grid",
    "held_back_score",
    "read",
    "run",
]
