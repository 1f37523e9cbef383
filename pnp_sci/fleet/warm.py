"""Loads and compiles what a solve needs, once in each process, so that it does not count as the solver's time."""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from pnp_sci.api import solve
from pnp_sci.fleet.job import Job
from pnp_sci.results.result import Result

ENOUGH = 62  # iterations: strong priors begin with 60 of total variation, the second of their own uses the first

_warm: set[str] = set()
_warming = threading.Lock()


def warm_up(job: Job, y: np.ndarray, options: dict[str, Any]) -> None:
    """Solve a measurement twice, from a decoder's estimate and without one, as far as it takes to meet all kernels.

    Parameters
    ----------
    job : Job
    y : ndarray, (n, H, W)
    options : dict
        For :func:`pnp_sci.solve`.
    """

    def solved(**own: Any) -> Result:
        return solve(y, job.masks, **(options | own))

    with _warming:
        if job.fingerprint in _warm:
            return
        if options.get("prior") == "auto":  # it depends on the time budget
            options = options | {"prior": solved(iterations=1).settings["prior"]}
        solved(iterations=1, time_budget=None)
        solved(iterations=min(ENOUGH, options.get("iterations") or ENOUGH), time_budget=None, init="adjoint")
        _warm.add(job.fingerprint)
