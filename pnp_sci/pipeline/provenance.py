"""What every result says of its input and of the software that made it."""

from __future__ import annotations

import hashlib
import platform
import sys
import time
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from typing import Any

import numpy as np

from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem


def provenance(y: Any, masks: Any, largest: float, problems: Sequence[Problem], began: float) -> dict[str, Any]:
    """Units and noise of each measurement, hashes of the input, versions, and the seconds since `began`.

    `largest` is what the masks were divided by.
    """
    units = [float(np.mean(problem.unit)) for problem in problems]
    return {
        "noise": [problem.typical_noise * unit * largest for problem, unit in zip(problems, units)],
        "unit": units,
        "y": digest(y),
        "bad": _bad(problems),
        "masks": digest(masks.masks if isinstance(masks, SensingOperator) else masks),
        "versions": dict(versions("torch" in sys.modules)),
        "seconds": time.perf_counter() - began,
    }


def _bad(problems: Sequence[Problem]) -> str | None:
    """SHA-256 of the bad pixels of all measurements; None if there are none."""
    if all(problem.bad is None for problem in problems):
        return None
    nothing = np.zeros(problems[0].y.shape, bool)
    return digest(np.stack([nothing if problem.bad is None else problem.bad for problem in problems]))


@cache
def versions(torch: bool) -> dict[str, str]:
    """Versions of what determines a result."""
    packages = ("pnp-sci", "numpy", "numba", *(("torch",) if torch else ()))
    return {package: version(package) for package in packages} | {"python": platform.python_version()}


def digest(array: Any) -> str:
    """SHA-256 of the values as they came, in C order."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()
