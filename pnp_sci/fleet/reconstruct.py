"""``reconstruct``: any number of measurements, from disk to disk."""

from __future__ import annotations

import inspect
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._validate import instance, real_array, shown, whole
from pnp_sci.camera.calibration import Calibration
from pnp_sci.errors import UnknownPluginError
from pnp_sci.fleet import store
from pnp_sci.fleet.estimate import Estimate, free_bytes
from pnp_sci.fleet.job import EACH, Chunk, Job
from pnp_sci.fleet.pictures import digest_of_all, read_each
from pnp_sci.fleet.reconstruction import Reconstruction
from pnp_sci.fleet.settings import check_options, settings_of, with_defaults
from pnp_sci.fleet.source import Source, corrected, open_source
from pnp_sci.formats.replacing import check_writable
from pnp_sci.masks import as_masks
from pnp_sci.pipeline.progress import bar
from pnp_sci.pipeline.request import check_request
from pnp_sci.plugins import registry
from pnp_sci.sensing.problem import check_bad, check_operator

_log = logging.getLogger("pnp_sci.fleet")


def reconstruct(
    source: Any,
    masks: Any,
    out: str | Path = "video.zarr",
    client: Any = None,
    *,
    key: str | None = None,
    workers: int | None = None,
    sequence: int | None = None,
    preview: str | None = None,
    progress: bool = False,
    **options: Any,
) -> Reconstruction:
    """Recover the videos of any number of measurements, out of core and on several processes or computers.

    A call that was killed is repeated as it was: what is done stays, and the result is bit for bit the same.

    Parameters
    ----------
    source : path, sequence of paths, or array-like (N, H, W)
        The measurements: a zarr array, HDF5, NPY, a TIFF stack, a folder or a list of files, or an array, of which
        masked values are bad pixels. Only what a chunk needs is read.
    masks : array_like, (V, B, H, W) or (B, H, W), SensingOperator, or Calibration
        As for :func:`pnp_sci.solve`. With a calibration the source holds raw pictures, which it corrects;
        tell what is saturated by ``noise=Sensor(full_scale=masks.saturation, black_level=masks.black_level)``.
    out : path
        Folder for the result, OME-Zarr 0.5. Workers must see it under the same path.
    client : None, str or distributed.Client
        Where to solve: in processes of this computer, on the cluster of a scheduler's address, or of a client.
    key : str, optional
        Name of the measurements in a file or group with several arrays.
    workers : int, optional
        Processes on this computer. By default one for each physical core, if memory suffices.
    sequence : int, optional
        Reconstruct so many consecutive measurements as one video.
    preview : str, optional
        A decoder or a prior, such as "ofanet-fast" or "tv": first write its quick results of all measurements.
    progress : bool
        Whether to show a progress bar.
    **options
        For :func:`pnp_sci.solve`. `threads` are those of each process. `bad` (N, H, W) and `init` (N, V, B, H, W) are
        those of each measurement.

    Returns
    -------
    Reconstruction
        A measurement that cannot be solved is recorded with its error, and does not stop the others.

    Raises
    ------
    InputError, InputTypeError, FormatError
        If an argument cannot be used, `out` holds a result of other settings, another run is writing there, or its
        disk lacks room.
    OSError
        If nothing more can be written to `out`.
    MissingExtraError
        If the extra "cluster" is not installed.

    Examples
    --------
    >>> import pnp_sci
    >>> videos = pnp_sci.reconstruct("capture.npy", masks, "videos.zarr", prior="tv")  # doctest: +SKIP
    >>> videos.video(0).shape, videos.status  # doctest: +SKIP
    ((1, 8, 128, 128), '200 measurements: 200 the iterates stopped changing')
    """
    from pnp_sci.fleet.cluster import check_client, cores, workers_of

    check_client(client)
    sequence = None if sequence is None else whole("sequence", sequence, 1)
    workers = cores() if workers is None else whole("workers", workers, 1)
    instance("progress", progress, bool)
    opened, calibration = open_source(source, key), masks if isinstance(masks, Calibration) else None
    if calibration is not None:
        opened, masks = corrected(opened, calibration), calibration.masks
    planes, path = as_masks(masks), Path(out).resolve()
    options |= {name: real_array(name, options[name]) for name in EACH if isinstance(options.get(name), (list, tuple))}
    _check(opened, planes, preview, options)
    settings = settings_of(opened, planes, sequence, options, calibration)
    if not path.exists():
        check_writable(path)
    with store.only_run(path):
        if path.exists():
            store.check_same(path, settings)
            store.sweep(path)
        else:
            store.create(path, planes, settings, uncertainty=bool(options.get("uncertainty")))
        settings = store.settings_in(path)  # equal, but perhaps not in the same words, such as 1 and 1.0
        job = Job(opened, planes, options, sequence, preview, settings, str(path))
        missing = _missing(job)
        if len(missing):
            most = min(workers, len(missing)) if client is None else workers
            threads = max(1, cores() // most) if client is None else 1
            job = replace(job, options={"threads": threads, **options})
            with workers_of(client, job, most) as team:
                _run(team, job, missing, progress)
    return Reconstruction(path)


def _check(source: Source, masks: np.ndarray, preview: Any, options: dict[str, Any]) -> None:
    """Raise the errors of the arguments that no measurement is needed for."""
    check_options(options)
    instance("preview", preview, str)
    if preview is not None:
        _check_preview(preview)
    bad, dtype = options.get("bad"), np.dtype(np.float64 if source.dtype == np.float64 else np.float32)
    check_bad(
        bad,
        np.broadcast_to(dtype.type(0), (source.count if getattr(bad, "ndim", 0) == EACH["bad"] else 1, *source.shape)),
    )
    known = inspect.signature(check_request).parameters
    asked = {name: value for name, value in with_defaults(options).items() if name in known}
    check_request(check_operator(masks, np.zeros((1, *source.shape), dtype))[0], source.count, **asked)


def _check_preview(name: str) -> None:
    """Raise an error if there is neither a decoder nor a prior of this name, or it cannot be loaded."""
    known = {name: kind for kind in ("priors", "decoders") for name in registry.available(kind)}
    if name not in known:
        raise UnknownPluginError(f"preview is {shown(name)}: one of these was expected: {', '.join(sorted(known))}")
    registry.load(known[name], name)


def _missing(job: Job) -> np.ndarray:
    """Where the chunks begin that have no result."""
    return np.fromiter((chunk.start for chunk in job.chunks() if not _done(job, chunk)), np.int64)


def _done(job: Job, chunk: Chunk, preview: bool = False) -> bool:
    """Whether a chunk has a result, or a preview, of all that is read for it now."""
    records = [store.record(Path(job.store), n) for n in range(*chunk)]
    for record in records:
        if record is None or record["error"] or record["settings"] != job.fingerprint:
            return False
        if (record["method"] == "solve") is preview:
            return False
    read = digest_of_all(read_each(job.source.read, *job.around(chunk, preview)))
    return all(record["read"] == read for record in records if record)


def _run(team: Any, job: Job, missing: np.ndarray, progress: bool) -> None:
    """Solve what is missing: one chunk to estimate the rest, previews if asked for, then all."""
    count, out = sum(chunk.stop - chunk.start for chunk in map(job.chunk, missing)), Path(job.store)
    with bar(total=count, unit="measurement", shown=progress) as solved:
        taken: dict[str, Any] = {}

        def done(chunk: Chunk, facts: dict[str, Any]) -> None:
            taken.update(facts)
            solved.update(chunk.stop - chunk.start)

        first = 0
        while first < len(missing) and "memory" not in taken:  # a chunk that fails tells nothing
            team.run([job.chunk(missing[first])], done, measure=True)
            first += 1
        rest = missing[first:]
        if "memory" in taken and len(rest):
            team.fit(taken["memory"])
            estimate = _estimate(team, job, job.chunk(missing[first - 1]), rest, taken)
            _log.info("%s", estimate)
            estimate.check(out)
        if job.preview and len(rest):
            _preview(team, job, rest, progress)
        team.run(map(job.chunk, rest), done)


def _preview(team: Any, job: Job, starts: np.ndarray, progress: bool) -> None:
    """Quick results of the chunks that have none."""
    chunks = (chunk for chunk in map(job.chunk, starts) if not _done(job, chunk, preview=True))
    with bar(desc=f"preview by {job.preview}", unit="measurement", shown=progress) as previewed:
        team.run(chunks, lambda chunk, facts: previewed.update(chunk.stop - chunk.start), preview=True)


def _estimate(team: Any, job: Job, first: Chunk, rest: np.ndarray, taken: dict[str, Any]) -> Estimate:
    """What the chunks that are left take, if each is like the first; a preview is written over."""
    out, arrays = Path(job.store), (store.VIDEO, store.ERRORS)
    left = sum(chunk.stop - chunk.start for chunk in map(job.chunk, rest))
    disk = sum(store.stored_bytes(out, n, arrays) for n in range(*first)) / (first.stop - first.start) * left
    return Estimate(
        left,
        team.size,
        taken["seconds"] * len(rest) / team.size,
        taken["memory"] * (team.size if team.local is not None else 1),
        disk,
        free_bytes(out),
    )
