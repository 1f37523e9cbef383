"""Plugins that stand for "auto"."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

from pnp_sci._validate import one_of
from pnp_sci.advice.recommend import LEARNED
from pnp_sci.solvers.effort import EFFORTS

DECODER = "ofanet-fast"  # the first estimate "auto" with a strong prior: quick, and better than "adjoint"

OFTEN = 2  # calls of "video" from one measurement of the motion to the next with effort="best"


def prior_for(effort: str) -> tuple[str, dict[str, Any]]:
    """The name and the options of the prior that "auto" stands for, without a time budget."""
    one_of("effort", effort, EFFORTS)
    if effort == "fast":
        return "tv", {}
    if not all(map(find_spec, LEARNED)):
        return "flow", {}
    return "video", {"renew": OFTEN} if effort == "best" else {}
