"""What texts of a result have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any


def counted(numbers: Sequence[int]) -> str:
    """``[0, 2]`` -> ``"1, 3"``; ten at most."""
    texts = [str(n + 1) for n in numbers[:10]]
    return ", ".join(texts) + (f" and {len(numbers) - 10} more" if len(numbers) > 10 else "")


def in_words(plan: dict[str, Any]) -> str:
    """A plan as :meth:`pnp_sci.solvers.plan.Plan.describe` gives it, in a line."""
    ends = [*(turn["from"] for turn in plan["serves"][1:]), plan["iterations"]]
    turns = [f"{turn['name']} to iteration {end} at most" for turn, end in zip(plan["serves"], ends)]
    first, last = plan["sigma"]
    sigma = f"sigma {first:.3g}" if first == last else f"sigma falling from {first:.3g} to {last:.3g}"
    return f"{plan['algorithm']}: {', then '.join(turns)}; {sigma}, rho {plan['rho']:.3g}"
