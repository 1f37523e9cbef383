"""Starts or connects to workers; sends chunks, a few at a time."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pnp_sci._optional import needed_for
from pnp_sci._validate import shown
from pnp_sci.errors import InputTypeError
from pnp_sci.fleet import store
from pnp_sci.fleet.job import Chunk, Job
from pnp_sci.fleet.pictures import in_a_line, read_each
from pnp_sci.fleet.work import JobPlugin, put_failures, solve_chunk

with needed_for("a fleet of measurements", "cluster"):
    import psutil
    import zarr  # noqa: F401, for the store
    from distributed import Client, Future, LocalCluster, as_completed
    from distributed.scheduler import KilledWorker

AHEAD = 2  # chunks a worker thread: one is solved while the next is on its way


def cores() -> int:
    """Physical cores that this process may use."""
    allowed = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    return max(1, min(psutil.cpu_count(logical=False) or allowed, allowed))


def check_client(client: Any) -> None:
    """Raise an InputTypeError if `client` is neither None, an address nor a Client."""
    if client is not None and not isinstance(client, (str, Client)):
        raise InputTypeError(
            f"client is {shown(client)}: None, a scheduler's address or a distributed.Client was expected"
        )


@contextmanager
def workers_of(client: Any, job: Job, workers: int) -> Iterator[Team]:
    """Context with the workers that the argument `client` stands for, each of which has the job.

    None is a cluster of this computer, with so many workers; an address is that of a scheduler. A Client is not closed
    at the end.
    """
    local = None
    if client is None:
        local = LocalCluster(
            n_workers=workers, threads_per_worker=1, processes=True, memory_limit=0, dashboard_address=":0",
            silence_logs=logging.ERROR,
        )  # fmt: skip
    own = not isinstance(client, Client)
    connected = Client(local if local is not None else client) if own else client
    try:
        connected.register_plugin(JobPlugin(job.for_workers()))
        try:
            yield Team(connected, local, job)
        finally:
            if local is None:  # on a cluster of others nothing stays
                connected.unregister_worker_plugin(job.name)
    finally:
        if own:
            connected.close()
        if local is not None:
            local.close()


class Team:
    """The workers of a run."""

    def __init__(self, client: Client, local: LocalCluster | None, job: Job):
        self.client, self.local, self.job = client, local, job

    def fit(self, memory: float) -> None:
        """Reduce the workers of a local cluster to what memory allows, if each takes so many bytes."""
        fitting = int(psutil.virtual_memory().available // memory) + 1  # one has its memory
        if self.local is not None and fitting < self.size:
            self.local.scale(fitting)
            while self.size > fitting:
                time.sleep(0.05)

    @property
    def size(self) -> int:
        """Chunks that are solved at the same time."""
        threads: Any = self.client.nthreads()
        return max(1, sum(threads.values()))

    def run(self, chunks: Iterable[Chunk], done: Callable[[Chunk, dict], None], preview=False, measure=False) -> None:
        """Solve chunks, and call ``done(chunk, facts)`` after each; only a few are on their way at any time."""
        job, waiting, sent, running = self.job, iter(chunks), dict[str, Chunk](), as_completed([])

        def send() -> None:
            while len(sent) < AHEAD * self.size and (chunk := next(waiting, None)) is not None:
                around = job.around(chunk, preview)
                each = None if job.source.travels else read_each(job.source.read, *around)
                arguments = job.name, chunk, each, job.own(around), preview, measure
                key = f"{job.fingerprint[:12]}-{'preview' if preview else 'solve'}-{chunk.start}-{id(self)}"
                sent[key] = chunk
                running.add(self.client.submit(solve_chunk, *arguments, key=key, pure=False))

        try:
            send()
            for future in running:
                chunk = sent.pop(future.key)
                done(chunk, self._facts(future, chunk, preview))
                future.release()
                send()
        finally:  # after an error nothing is written that is not waited for
            self.client.cancel([Future(key, self.client) for key in sent], force=True)

    def _facts(self, future: Any, chunk: Chunk, preview: bool) -> dict[str, Any]:
        """What a chunk returned; of one that has killed its workers again and again, that it failed."""
        error = future.exception()
        if error is None and "unwritten" not in future.result():
            return future.result()
        if not isinstance(error, KilledWorker):
            raise error or future.result()["unwritten"]
        facts = {"settings": self.job.fingerprint, "method": self.job.preview if preview else "solve"}
        with store.writing(Path(self.job.store)):
            put_failures(Path(self.job.store), chunk, facts, in_a_line(error))
        return {"errors": chunk.stop - chunk.start}
