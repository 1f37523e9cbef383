"""What a worker does: read a chunk, solve it, write the videos and then the records."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.accel.memory import peak_memory
from pnp_sci.accel.threads import limited
from pnp_sci.api import decode, solve
from pnp_sci.errors import InputError
from pnp_sci.fleet import store
from pnp_sci.fleet.job import Chunk, Job
from pnp_sci.formats.plain import as_json
from pnp_sci.pipeline.provenance import digest
from pnp_sci.plugins.registry import available
from pnp_sci.plugins.resolve import decoder_for
from pnp_sci.results.result import Result

with needed_for("a fleet of measurements", "cluster"):
    import psutil
    from distributed import WorkerPlugin, get_worker

_log = logging.getLogger("pnp_sci")
OF_ANY = "noise", "bad", "scene"  # options that each preview has too
OF_PRIORS = "device", "seed", "threads"  # ... one by a prior


class JobPlugin(WorkerPlugin):
    """Brings a job to each worker once, also to those that start later."""

    def __init__(self, job: Job):
        self.job, self.name = job, job.name

    def setup(self, worker: Any) -> None:
        """In a worker process, warnings go to the records only."""
        if worker.nanny:
            _log.propagate = False


def solve_chunk(job_name: str, chunk: Chunk, y: Any, preview: bool, measure: bool) -> dict[str, Any]:
    """Solve a chunk of a job and write it; `y` is what must be read for it, if the worker cannot.

    Returns
    -------
    dict
        "errors", the number of measurements that failed, and unless all did, "seconds" and "memory" in bytes. If
        `measure`, the seconds are without those that only the first chunk of a process takes.
    """
    plugin: Any = get_worker().plugins[job_name]
    job: Job = plugin.job
    path, facts = Path(job.store), {"settings": job.fingerprint, "method": job.preview if preview else "solve"}
    began = time.perf_counter()
    with _collected_warnings() as warnings:
        try:
            around = job.around(chunk, preview)
            y = job.source.read(*around) if y is None else y  # masked where pixels are bad
            inside = slice(chunk.start - around.start, chunk.stop - around.start)
            black = [n for n in range(chunk.start, chunk.stop) if not y[n - around.start].any()]
            nothing = InputError("y is 0 everywhere: a part of its file may be missing")
            if len(black) == chunk.stop - chunk.start:
                raise nothing
            if measure:
                _reconstruct(job, y, preview, iterations=1)  # kernels and weights are loaded
                warnings.clear()
                began = time.perf_counter()
            result = _reconstruct(job, y, preview)
            as_json([result.settings, result.scenes])  # raises an error for what a record cannot hold
        except Exception as error:
            put_failures(path, chunk, facts, error)
            return {"errors": chunk.stop - chunk.start}
    store.clear(path, *chunk)
    store.put_videos(path, chunk.start, result.x[inside])
    if result.uncertainty is not None:
        store.put_videos(path, chunk.start, result.uncertainty[inside], store.ERRORS)
    if measure:
        store.show_white(path, result.white)
    seconds = time.perf_counter() - began
    each = facts | {"read": digest(y), "seconds": seconds / len(result.x[inside]), "warnings": warnings}
    each |= {"result": result.settings}
    for n in range(chunk.start, chunk.stop):
        store.put_record(path, n, {"measurement": n} | _facts_of(result, y, n - around.start) | each)
    for n in black:
        put_failures(path, Chunk(n, n + 1), facts, nothing)
    memory = peak_memory() or getattr(psutil.Process().memory_info(), "peak_wset")  # noqa: B009, only on Windows
    return {"errors": len(black), "seconds": seconds, "memory": memory}


def _reconstruct(job: Job, y: np.ndarray, preview: bool, **more: Any) -> Result:
    """The videos (n, V, B, H, W) of measurements y (n, H, W)."""
    if preview:
        quick = {name: job.options[name] for name in OF_ANY if name in job.options}
        if job.preview in available("decoders"):
            decoder = decoder_for("preview", job.preview, {}, job.options.get("device"))
            with limited(job.options.get("threads")):
                return decode(y, job.masks, decoder, **quick)
        quick |= {name: job.options[name] for name in OF_PRIORS if name in job.options}
        return solve(y, job.masks, job.preview, effort="fast", **quick)
    together: dict[str, Any] = {"sequence": True} if job.sequence else {}
    return solve(y, job.masks, **(job.options | together | more))


def _facts_of(result: Result, y: np.ndarray, n: int) -> dict[str, Any]:
    """What a result says of its n-th measurement."""
    last = [record for record in result.history if record.measurement <= n][-1:]  # of a sequence, that of its window
    scene = result.scenes[n] if n < len(result.scenes) else {}
    return {
        "y": digest(y[n]),
        "status": result.status.value,
        "ok": result.status.ok,
        "iterations": last[0].iteration if last else None,
        "residual": last[0].residual if last else None,
        "remarks": scene.get("remarks", []),
        "scene": scene,
        "error": None,
    }


def put_failures(path: Path, chunk: Chunk, facts: dict[str, Any], error: BaseException) -> None:
    """Record that the measurements of a chunk failed; no earlier video of them stays."""
    text = " ".join(f"{type(error).__name__}: {error}".split())
    said = {"status": f"failed: {text}", "ok": False, "error": text, "seconds": None, "remarks": [], "warnings": []}
    store.clear(path, *chunk)
    for n in range(*chunk):
        store.put_record(path, n, {"measurement": n} | facts | said)


@contextmanager
def _collected_warnings() -> Iterator[list[str]]:
    """Context with the list of what this thread logs as warnings of this package."""
    texts, thread = [], threading.get_ident()
    handler = logging.Handler(logging.WARNING)
    handler.emit = lambda record: texts.append(record.getMessage()) if record.thread == thread else None
    _log.addHandler(handler)
    try:
        yield texts
    finally:
        _log.removeHandler(handler)
