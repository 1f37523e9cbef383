"""Plugins that stand for "auto"."""

from __future__ import annotations

from importlib.util import find_spec

from pnp_sci._validate import one_of
from pnp_sci.advice.recommend import LEARNED
from pnp_sci.solvers.effort import EFFORTS

DECODER = "ofanet-fast"  # the first estimate "auto" with a strong prior: quick, and better than "adjoint"


def prior_for(effort: str) -> str:
    """The name of the prior that "auto" stands for, without a time budget."""
    one_of("effort", effort, EFFORTS)
    if effort == "fast":
        return "tv"
    return "video" if all(map(find_spec, LEARNED)) else "flow"
