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
from pnp_sci.fleet import store
from pnp_sci.fleet.job import Chunk, Job, part_of
from pnp_sci.fleet.pictures import Picture, digest_of_all, in_a_line, read_each, runs, stacked, wrong_with
from pnp_sci.fleet.warm import warm_up
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


def solve_chunk(
    job_name: str, chunk: Chunk, each: list[Picture] | None, own: dict[str, Any], preview: bool, measure: bool
) -> dict[str, Any]:
    """Solve a chunk of a job and write it.

    Parameters
    ----------
    job_name : str
    chunk : Chunk
    each : list, or None
        What must be read for it, if the worker cannot.
    own : dict
        Options that are given for each measurement, of those that are read.
    preview, measure : bool
        Whether quick results are asked for; whether the time is to be measured.

    Returns
    -------
    dict
        "errors", the number of measurements that failed, and unless all did, "seconds" and "memory" in bytes. If
        `measure`, the seconds are without those that only the first chunk of a process takes. Or "unwritten", the error
        with which nothing can be written.
    """
    plugin: Any = get_worker().plugins[job_name]
    job: Job = plugin.job
    around, options = job.around(chunk, preview), job.options | own
    each = read_each(job.source.read, *around) if each is None else each
    found = {n: wrong_with(y, part_of(options, k).get("bad")) for k, (n, y) in enumerate(zip(range(*around), each))}
    wrong = {n: said for n, said in found.items() if said}
    facts = {"settings": job.fingerprint, "method": job.preview if preview else "solve", "read": digest_of_all(each)}
    solved: list[dict[str, Any]] = []
    try:
        with store.writing(Path(job.store)):
            for n in wrong.keys() & {*range(*chunk)}:
                put_failures(Path(job.store), Chunk(n, n + 1), facts, wrong[n])
            for run in runs(n for n in range(*around) if n not in wrong):  # what is wrong ends a sequence
                kept = Chunk(max(run.start, chunk.start), min(run.stop, chunk.stop))
                if kept.start < kept.stop:
                    where = slice(run.start - around.start, run.stop - around.start)
                    part = part_of(options, where) | {"sequence": bool(job.sequence)}
                    solved.append(_solve_run(job, run, kept, stacked(each[where]), part, facts, preview, measure))
    except OSError as error:
        return {"unwritten": error}
    count = sum(run["solved"] for run in solved)
    failed = {"errors": chunk.stop - chunk.start - count}
    if not count:
        return failed
    memory = peak_memory() or getattr(psutil.Process().memory_info(), "peak_wset")  # noqa: B009, only on Windows
    return failed | {"seconds": sum(run["seconds"] for run in solved), "memory": memory}


def _solve_run(
    job: Job, run: range, kept: Chunk, y: np.ndarray, options: dict[str, Any], facts: dict[str, Any],
    preview: bool, measure: bool,
) -> dict[str, Any]:  # fmt: skip
    """Solve consecutive measurements y (n, H, W), and write those that are kept."""
    path = Path(job.store)
    with _collected_warnings() as warnings:
        try:
            if not preview and (measure or options.get("time_budget") is not None):
                warm_up(job, y, options)
                warnings.clear()
            began = time.perf_counter()
            result = _quick(job, y, options) if preview else solve(y, job.masks, **options)
            as_json([result.settings, result.scenes])  # raises an error for what a record cannot hold
        except Exception as error:
            put_failures(path, kept, facts, in_a_line(error))
            return {"solved": 0, "seconds": 0.0}
    inside = slice(kept.start - run.start, kept.stop - run.start)
    store.clear(path, *kept)
    store.put_videos(path, kept.start, result.x[inside])
    if result.uncertainty is not None:
        store.put_videos(path, kept.start, result.uncertainty[inside], store.ERRORS)
    if measure:
        store.show_white(path, result.white)
    seconds, count = time.perf_counter() - began, kept.stop - kept.start
    shared = facts | {"seconds": seconds / count, "warnings": warnings, "result": result.settings}
    for n in range(*kept):
        store.put_record(path, n, {"measurement": n} | _facts_of(result, y, n - run.start) | shared)
    return {"solved": count, "seconds": seconds}


def _quick(job: Job, y: np.ndarray, options: dict[str, Any]) -> Result:
    """The videos (n, V, B, H, W) by the method of previews."""
    quick = {name: options[name] for name in OF_ANY if name in options}
    if job.preview in available("decoders"):
        decoder = decoder_for("preview", job.preview, {}, options.get("device"))
        with limited(options.get("threads")):
            return decode(y, job.masks, decoder, **quick)
    quick |= {name: options[name] for name in OF_PRIORS if name in options}
    return solve(y, job.masks, job.preview, effort="fast", **quick)


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


def put_failures(path: Path, chunk: Chunk, facts: dict[str, Any], text: str) -> None:
    """Record that the measurements of a chunk failed, with an error; no earlier video of them stays."""
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
