"""Benchmarks of methods on known scenes, each in a separate process, and comparisons on one measurement."""

from pnp_sci.bench.cases import Case, expand
from pnp_sci.bench.comparison import Comparison, Trial, compare
from pnp_sci.bench.curves import curves, draw, front, front_table
from pnp_sci.bench.held_back import held_back_score
from pnp_sci.bench.methods import Method, Source, grid
from pnp_sci.bench.results import Results, read
from pnp_sci.bench.runner import Checkpoint, Row, as_markdown, run

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
    "front",
    "front_table",
    "grid",
    "held_back_score",
    "read",
    "run",
]
