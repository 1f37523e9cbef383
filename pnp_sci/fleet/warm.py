"""Loads and compiles what a solve needs, once in each process, so that it does not count as the solver's time."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from pnp_sci.api import solve
from pnp_sci.fleet.job import Job, part_of
from pnp_sci.fleet.settings import with_defaults
from pnp_sci.plugins.combine import turns
from pnp_sci.plugins.resolve import as_prior

CALLS = 2  # of a strong prior: the second one uses what the first found

_warm: set[str] = set()
_warming = threading.Lock()


def warm_up(job: Job, y: np.ndarray, options: dict[str, Any]) -> None:
    """Solve two measurements, from a decoder's estimate and without one, as far as it takes to meet all kernels.

    Parameters
    ----------
    job : Job
    y : ndarray, (n, H, W)
        Those that are solved next: "auto" takes a prior that their time budget allows.
    options : dict
        For :func:`pnp_sci.solve`.
    """
    first = part_of(options, slice(2))

    def solved(**own: Any) -> None:
        given: dict[str, Any] = first | own | {"time_budget": None}
        solve(y[:2], job.masks, **given)

    with _warming:
        if job.fingerprint in _warm:
            return
        once: dict[str, Any] = options | {"iterations": 1}
        for _ in range(2 if options.get("prior") == "auto" else 0):  # the first one loads what the choice depends on
            first["prior"] = solve(y, job.masks, **once).settings["prior"]
        solved(iterations=1)
        limits = _enough(first, job.masks.shape), options.get("iterations")
        solved(iterations=min((limit for limit in limits if limit is not None), default=None), init="adjoint")
        _warm.add(job.fingerprint)


def _enough(options: dict[str, Any], shape: tuple[int, ...]) -> int | None:
    """Iterations up to a second call of the prior that serves last; None, a whole solve, of a plain prior alone."""
    given = with_defaults(options)
    prior = as_prior(given["prior"], device=given["device"], seed=given["seed"], **given["prior_options"])
    before = turns(prior, shape)[-1].begins
    return before + CALLS if before or prior.traits(shape).strong else None
