"""Loads and compiles what a solve needs, once in each process, so that it does not count as the solver's time."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from pnp_sci.api import solve
from pnp_sci.fleet.job import Job, part_of

ENOUGH = 62  # iterations: strong priors begin with 60 of total variation, and a second call uses what the first found

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
        solved(iterations=min(ENOUGH, options.get("iterations") or ENOUGH), init="adjoint")
        _warm.add(job.fingerprint)
