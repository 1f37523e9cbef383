"""Measurement of one method on one case, in a separate process so that the peak memory is that of the method."""

from __future__ import annotations

import json
import platform
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci import metrics
from pnp_sci.accel.memory import peak_memory
from pnp_sci.advice.recommend import calibrate, calibrate_networks
from pnp_sci.bench.cases import Case
from pnp_sci.bench.methods import Method
from pnp_sci.datasets import embedded_scene
from pnp_sci.errors import SolverError
from pnp_sci.results.history import Record
from pnp_sci.results.result import Result

WORKER = """
import runpy, sys
sys.path = [folder for folder in sys.path if folder]  # never the current folder, whose files may be anybody's
runpy.run_module("pnp_sci.bench", run_name="__main__")
"""
KEPT = 5  # iterations from one checkpoint to the next, after the first ten


@dataclass(frozen=True)
class Checkpoint:
    """State of a solver after an iteration: means over the measurements of the case.

    Attributes
    ----------
    iteration : int
    seconds : float
        Time for one measurement since the call, without loading, compilation and metrics.
    psnr : float or None
        Mean over the views in dB; None without truth.
    residual : float
        ``||y - Phi x|| / ||y||``
    """

    iteration: int
    seconds: float
    psnr: float | None
    residual: float


@dataclass(frozen=True)
class Row:
    """The result of one method on one case.

    Attributes
    ----------
    case : Case
    method : Method
    shape : tuple of int
        (V, B, H, W)
    status : str
    iterations : int
        Number for the last measurement.
    psnr, ssim : tuple of float
        One value per view, mean over the measurements; empty without truth.
    seconds : tuple of float
        Time for one measurement in each repetition, without loading and compilation.
    loading : float
        Additional seconds of the first call in a process.
    peak_mib : float or None
        Largest resident memory of the process in MiB, including interpreter, libraries and metrics; None if unknown.
    course : tuple of Checkpoint
    settings : dict
        See `Result.settings`.
    machine : dict
        See :func:`machine`.
    """

    case: Case
    method: Method
    shape: tuple[int, ...]
    status: str
    iterations: int
    psnr: tuple[float, ...]
    ssim: tuple[float, ...]
    seconds: tuple[float, ...]
    loading: float
    peak_mib: float | None
    course: tuple[Checkpoint, ...]
    settings: dict[str, Any]
    machine: dict[str, Any]

    @classmethod
    def from_dict(cls, row: dict[str, Any]) -> Row:
        """Convert a dict, made by ``asdict`` or read from JSON, to a row."""
        lists = {key: tuple(row[key]) for key in ("shape", "psnr", "ssim", "seconds")}
        course = tuple(Checkpoint(**point) for point in row["course"])
        return cls(**{**row, **lists, "case": Case(**row["case"]), "method": Method(**row["method"]), "course": course})


def run(case: Case, method: Method, repeat: int = 1) -> Row:
    """Measure a method on a case in a new process.

    Parameters
    ----------
    case : Case
    method : Method
    repeat : int
        Number of time measurements, at least 1.

    Returns
    -------
    Row

    Raises
    ------
    SolverError
        If the process fails; the message is the last line of its error output.
    """
    request = json.dumps({"case": asdict(case), "method": asdict(method), "repeat": repeat})
    done = subprocess.run([sys.executable, "-c", WORKER, request], capture_output=True, text=True)
    if done.returncode:
        reason = (done.stderr.strip().splitlines() or [f"exit code {done.returncode}"])[-1]
        raise SolverError(f"{case.name} with {method.name}: {reason}")
    return Row.from_dict(json.loads(done.stdout.splitlines()[-1]))


def measure(case: Case, method: Method, repeat: int = 1) -> Row:
    """As :func:`run`, but in this process; the peak memory is that of the process so far."""
    scene = case.load()
    count = len(scene.y) if scene.y.ndim == 3 else 1
    small = embedded_scene(64)
    loading = _seconds(lambda: method.run(small.y, small.masks))  # with loading and compilation
    loading -= _seconds(lambda: method.run(small.y, small.masks))
    one, its = scene.y.reshape(-1, *scene.y.shape[-2:])[0], scene.masks.reshape(-1, *scene.masks.shape[-4:])[0]
    brief = method if method.prior is None else replace(method, iterations=1)
    brief.run(one, its)  # compiles kernels that small arrays do not use
    results = [method.run(scene.y, scene.masks, reference=scene.truth) for _ in range(repeat)]
    seconds = tuple(result.settings["seconds"] / count for result in results)
    peak = None if (taken := peak_memory()) is None else taken / 2**20
    middle = results[int(np.argsort(seconds)[(repeat - 1) // 2])]
    psnr, ssim = scores(middle.x, scene.truth)
    return Row(
        case, method, its.shape, middle.status.name.lower().replace("_", " "), middle.history[-1].iteration,
        psnr, ssim, seconds, max(loading, 0.0), peak, _course(middle, count, psnr), middle.settings, machine(),
    )  # fmt: skip


def _course(result: Result, count: int, psnr: Sequence[float]) -> tuple[Checkpoint, ...]:
    """Checkpoints, means over the measurements; the time outside the iterations is added before the first one."""
    films = [[record for record in result.history if record.measurement == n] for n in range(count)]
    before = result.settings["seconds"] / count - float(np.mean([film[-1].seconds for film in films]))
    last = max(film[-1].iteration for film in films)
    points = []
    for k in range(last + 1):
        if k > 10 and k % KEPT and k != last:
            continue
        records: list[Record] = [film[min(k, len(film) - 1)] for film in films]
        known = [r.psnr for r in records if r.psnr is not None]
        quality = float(np.mean(known)) if known else float(np.mean(psnr)) if psnr else None
        seconds, residual = (float(np.mean(values)) for values in zip(*((r.seconds, r.residual) for r in records)))
        points.append(Checkpoint(k, before + seconds, quality, residual))
    return tuple(points)


def machine() -> dict[str, Any]:
    """Description of the computer, its speed, and the versions of the software; values for JSON."""
    from importlib.metadata import PackageNotFoundError, version

    import numba

    versions = {}
    for name in ("pnp-sci", "numpy", "numba", "torch"):
        try:
            versions[name] = version(name)
        except PackageNotFoundError:
            continue
    return {
        "platform": f"{platform.system()} {platform.machine()}",
        "processor": platform.processor(),
        "threads": numba.get_num_threads(),
        "calibration": calibrate(),
        "networks": calibrate_networks() if "torch" in versions else None,
        "python": platform.python_version(),
        **versions,
        "revision": _revision(),
    }


def _revision() -> str | None:
    """The commit of the sources, with a + if they have changes; None outside a repository."""
    try:
        done = subprocess.run(
            ["git", "describe", "--always", "--dirty=+"], cwd=Path(__file__).parent, capture_output=True, text=True
        )
    except OSError:
        return None
    return done.stdout.strip() or None


def as_markdown(rows: Iterable[Row]) -> str:
    """Rows as a Markdown table; views are separated by a slash, seconds are median and range."""
    lines = ["| case | method | PSNR (dB) | SSIM | seconds | peak MiB | iterations | status |", "|" + " --- |" * 8]
    for row in rows:
        spread = f" ({min(row.seconds):.2f}-{max(row.seconds):.2f})" if len(row.seconds) > 1 else ""
        cells = (
            row.case.name,
            row.method.name,
            " / ".join(f"{value:.2f}" for value in row.psnr) or "-",
            " / ".join(f"{value:.3f}" for value in row.ssim) or "-",
            f"{np.median(row.seconds):.2f}{spread}",
            "-" if row.peak_mib is None else f"{row.peak_mib:.0f}",
            str(row.iterations),
            row.status,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def scores(
    x: np.ndarray, truth: np.ndarray | None, colour: bool = False
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """PSNR in dB and SSIM of each view, mean over the measurements; empty without truth.

    x is (..., V, B, H, W), or with `colour` (..., V, B, H, W, 3).

    >>> scores(np.zeros((3, 2, 1, 16, 16)), np.zeros((3, 2, 1, 16, 16)))
    ((inf, inf), (1.0, 1.0))
    """
    if truth is None:
        return (), ()
    film = x.shape[-4:] if colour else x.shape[-3:]
    views, films = x.shape[-len(film) - 1], x.reshape(-1, *film)
    psnr, ssim = (
        tuple(metric(films, truth.reshape(films.shape)).reshape(-1, views).mean(0).tolist())
        for metric in (metrics.psnr, metrics.ssim)
    )
    return psnr, ssim


def _seconds(call: Any) -> float:
    start = time.perf_counter()
    call()
    return time.perf_counter() - start
