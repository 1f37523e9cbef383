"""Plugins that stand for "auto"."""

from __future__ import annotations

from importlib.util import find_spec

from pnp_sci.plugins.registry import LEARNED

DECODER = "ofanet-fast"  # the first estimate "auto" with a strong prior: quick, and better than "adjoint"


def prior_for(effort: str) -> str:
    """The name of the prior that "auto" stands for, without a time budget."""
    if effort == "fast":
        return "tv"
    return "video" if all(map(find_spec, LEARNED)) else "flow"
