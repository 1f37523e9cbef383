"""The result of a fleet, on disk."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._validate import whole
from pnp_sci.errors import InputError, SolverError
from pnp_sci.fleet import store
from pnp_sci.formats.zarr import library

COLUMNS = ("measurement", "method", "ok", "status", "seconds", "iterations", "residual", "remarks", "warnings", "error")


class Reconstruction:
    """Videos of N measurements in an OME-Zarr folder, read only when asked for.

    Parameters
    ----------
    path : path
        Folder that :func:`pnp_sci.reconstruct` has written, or is writing.

    Attributes
    ----------
    path : Path
    x : zarr.Array, (N * B, V, H, W)
        Frames of all measurements one after the other, views, rows, columns. NaN where nothing is solved yet.
    uncertainty : zarr.Array or None
        Like x, where it was asked for.
    settings : dict
        What the measurements share: options, versions, hash of the masks.

    Raises
    ------
    FormatError
        If the folder is something else.

    Examples
    --------
    >>> import pnp_sci
    >>> pnp_sci.Reconstruction("no.zarr")
    Traceback (most recent call last):
    pnp_sci.errors.FormatError: no.zarr is no result of pnp-sci reconstruct: another place was expected
    """

    def __init__(self, path: str | Path):
        self.path = Path(path)
        self.settings: dict[str, Any] = store.settings_in(self.path)
        group = library().open_group(self.path, mode="r")
        self.x: Any = group[store.VIDEO]
        self.uncertainty: Any = group.get(store.ERRORS)

    def __len__(self) -> int:
        return self.settings["measurements"]

    def video(self, n: int) -> np.ndarray:
        """The video (V, B, H, W) of the n-th measurement, from 0."""
        if whole("n", n, 0) >= len(self):
            raise InputError(f"n is {n}: there are {len(self)} measurements, from 0")
        frames = self.x.chunks[0]
        return np.ascontiguousarray(self.x[n * frames : (n + 1) * frames].swapaxes(0, 1))

    def record(self, n: int) -> dict[str, Any]:
        """All that is known of the n-th measurement: status, settings, scene, hashes; {} while it is not solved."""
        return store.record(self.path, n) or {}

    def records(self) -> Iterator[dict[str, Any]]:
        """The record of each measurement that has one, in order."""
        return (record for n in range(len(self)) if (record := self.record(n)))

    def table(self) -> list[dict[str, Any]]:
        """A row for each measurement that has a record: status, seconds, remarks. ``pandas.DataFrame`` takes it."""
        return [{name: record.get(name) for name in COLUMNS} for record in self.records()]

    @property
    def status(self) -> str:
        """How many measurements ended how, in a sentence."""
        return self._judged()[0]

    @property
    def ok(self) -> bool:
        """Whether all measurements are solved, none failed, and none is a preview."""
        return self._judged()[1]

    def raise_for_status(self) -> None:
        """Raise a SolverError if a measurement failed or is not solved."""
        status, ok = self._judged()
        if not ok:
            raise SolverError(status)

    def _judged(self) -> tuple[str, bool]:
        """What :attr:`status` and :attr:`ok` say, for which each record is read once."""
        counts, solved = Counter[str](), 0
        for record in self.records():
            counts[_ending(record)] += 1
            solved += record["ok"] and record["method"] == "solve"
        if missing := len(self) - counts.total():
            counts["not solved"] = missing
        said = "; ".join(f"{count} {ending}" for ending, count in counts.most_common())
        return f"{len(self)} measurements: {said}", solved == len(self)

    def __repr__(self) -> str:
        total, views, rows, columns = self.x.shape
        frames = total // len(self)
        size = f"{views} view{'s' * (views != 1)} x {frames} frames of {rows} x {columns}"
        return f"Reconstruction({self.path}: {size}; {self.status})"


def _ending(record: dict[str, Any]) -> str:
    if record["error"]:
        return "failed"
    return record["status"] if record["method"] == "solve" else f"preview by {record['method']}"
