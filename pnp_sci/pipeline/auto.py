"""Plugins that stand for "auto"."""

from __future__ import annotations

from importlib.util import find_spec

from pnp_sci._validate import one_of
from pnp_sci.advice.recommend import LEARNED
from pnp_sci.solvers.effort import EFFORTS

AUTO = {"fast": "tv", "balanced": "video", "best": "video"}  # the prior "auto"
AUTO_UNLEARNED = {"fast": "tv", "balanced": "flow", "best": "flow"}  # ... where PyTorch is missing
NETWORK = "ofanet-fast"  # the first estimate "auto" beside a network: the quickest that is better than "adjoint"


def prior_for(effort: str) -> str:
    """The name of the prior that "auto" stands for, without a time budget."""
    one_of("effort", effort, EFFORTS)
    return AUTO[effort] if all(map(find_spec, LEARNED)) else AUTO_UNLEARNED[effort]
