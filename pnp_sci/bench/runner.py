"""Measure one case with one prior, in a process of its own: only there does peak memory mean something."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import time
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .. import metrics
from ..datasets import embedded_scene
from ..errors import SolverError


@dataclass(frozen=True)
class Row:
    """One line of the table.

    Attributes
    ----------
    case, prior, status : str
    iterations : int
        Of the last measurement.
    psnr, ssim : tuple of float
        One value per view, mean over the measurements; empty where no truth is known.
    seconds : tuple of float
        Of each repetition, all measurements of the case together. Loading and compiling are not in it.
    peak_mib : float or None
        Largest resident memory of the whole process, interpreter and libraries included; None where it is not known.
    """

    case: str
    prior: str
    status: str
    iterations: int
    psnr: tuple[float, ...]
    ssim: tuple[float, ...]
    seconds: tuple[float, ...]
    peak_mib: float | None


def run(case: str, prior: str, repeat: int = 1, iterations: int | None = None) -> Row:
    """Measure in a new process.

    Parameters
    ----------
    case : str
        See :func:`pnp_sci.bench.expand`.
    prior : str
        Name of an installed prior.
    repeat : int
        How often to measure the time, at least 1.
    iterations : int, optional
        Default: the solver's.

    Raises
    ------
    SolverError
        If the process fails; the message is its last line.
    """
    request = json.dumps({"case": case, "prior": prior, "repeat": repeat, "iterations": iterations})
    done = subprocess.run([sys.executable, "-m", "pnp_sci.bench", request], capture_output=True, text=True)
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SolverError(f"{case} with {prior}: {reason}")
    row: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    row.update({key: tuple(row[key]) for key in ("psnr", "ssim", "seconds")})
    return Row(**row)


def as_json(rows: Iterable[Row]) -> str:
    """The rows, and on what they were measured."""
    return json.dumps({"machine": machine(), "rows": [asdict(row) for row in rows]}, indent=2)


def machine() -> dict[str, Any]:
    """On what something was measured: the computer and the versions of what computed it."""
    from importlib.metadata import version

    import numba

    return {
        "platform": platform.platform(),
        "processor": platform.processor(),
        "threads": numba.get_num_threads(),
        "python": platform.python_version(),
        **{name: version(name) for name in ("pnp-sci", "numpy", "numba")},
    }


def as_markdown(rows: Iterable[Row]) -> str:
    """A table; views are parted by a slash, seconds are the median and the spread.

    >>> print(as_markdown([Row("wheel", "tv", "converged", 60, (), (), (1.0, 3.0), 210.4)]).splitlines()[-1])
    | wheel | tv | - | - | 2.00 (1.00-3.00) | 210 | 60 | converged |
    """
    lines = ["| case | prior | PSNR (dB) | SSIM | seconds | peak MiB | iterations | status |", "|" + " --- |" * 8]
    for row in rows:
        spread = f" ({min(row.seconds):.2f}-{max(row.seconds):.2f})" if len(row.seconds) > 1 else ""
        cells = (
            row.case,
            row.prior,
            " / ".join(f"{value:.2f}" for value in row.psnr) or "-",
            " / ".join(f"{value:.3f}" for value in row.ssim) or "-",
            f"{np.median(row.seconds):.2f}{spread}",
            "-" if row.peak_mib is None else f"{row.peak_mib:.0f}",
            str(row.iterations),
            row.status,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def measure(case: str, prior: str, repeat: int, iterations: int | None) -> Row:
    """As :func:`run`, in this process: peak memory is that of all it has done."""
    from ..api import solve
    from .cases import load

    scene = load(case)
    solve(scene.y, scene.masks, prior, iterations=1)  # loads the kernels
    small = embedded_scene(64)
    solve(small.y, small.masks, prior, iterations=45)  # ... and what has its turn later
    seconds = []
    for _ in range(repeat):
        start = time.perf_counter()
        result = solve(scene.y, scene.masks, prior, iterations=iterations)
        seconds.append(time.perf_counter() - start)
    peak = _peak_mib()
    status = result.status.name.lower().replace("_", " ")
    return Row(case, prior, status, result.history[-1].iteration, *scores(result.x, scene.truth), tuple(seconds), peak)


def scores(x: np.ndarray, truth: np.ndarray | None) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """PSNR and SSIM of each view, mean over the measurements; empty without truth.

    >>> scores(np.zeros((3, 2, 1, 16, 16)), np.zeros((3, 2, 1, 16, 16)))
    ((inf, inf), (1.0, 1.0))
    """
    if truth is None:
        return (), ()
    views, films = x.shape[-4], x.reshape(-1, *x.shape[-3:])
    psnr, ssim = (
        tuple(metric(films, truth.reshape(films.shape)).reshape(-1, views).mean(0).tolist())
        for metric in (metrics.psnr, metrics.ssim)
    )
    return psnr, ssim


def _peak_mib() -> float | None:
    """The high-water mark of this program; on Linux, ru_maxrss is no less than the parent's was when it forked."""
    status = Path("/proc/self/status")
    if status.exists():
        lines = dict(line.split(":", 1) for line in status.read_text().splitlines())
        return int(lines["VmHWM"].split()[0]) / 1024
    try:
        import resource
    except ImportError:  # Windows
        return None
    unit = 1 if sys.platform == "darwin" else 1024  # bytes there, KiB elsewhere
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / 2**20
