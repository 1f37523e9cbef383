"""What all chunks of a run share."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from pnp_sci.fleet.source import Source

EACH = {"bad": 3, "init": 5}  # options of solve that may differ between measurements: their dimensions if they do


class Chunk(NamedTuple):
    """Measurements `start` to `stop` - 1."""

    start: int
    stop: int


@dataclass(frozen=True, eq=False)
class Job:
    """A run, as each worker gets it once.

    Attributes
    ----------
    source : Source
    masks : ndarray, (V, B, H, W)
    options : dict
        For :func:`pnp_sci.solve`.
    sequence : int or None
        How many consecutive measurements are reconstructed as one video.
    preview : str or None
        Method of the quick results that come first.
    settings : dict
        All that determines the result, as JSON can hold it.
    store : str
        Folder of the result.
    """

    source: Source
    masks: np.ndarray
    options: dict[str, Any]
    sequence: int | None
    preview: str | None
    settings: dict[str, Any]
    store: str

    @property
    def name(self) -> str:
        """The name of the run on the workers."""
        return f"pnp-sci {self.store}"

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of the settings."""
        return hashlib.sha256(json.dumps(self.settings, sort_keys=True).encode()).hexdigest()

    def for_workers(self) -> Job:
        """The job without what the client sends with each chunk: what only it can read, and `own` options."""
        source = self.source if self.source.travels else replace(self.source, read=None)
        return replace(self, source=source, options={k: v for k, v in self.options.items() if not _of_each(k, v)})

    def own(self, part: Chunk) -> dict[str, Any]:
        """The options that are given for each measurement, of a part of them."""
        return part_of({k: v for k, v in self.options.items() if _of_each(k, v)}, slice(*part))

    @property
    def size(self) -> int:
        """Measurements per chunk."""
        return self.sequence or 1

    def chunk(self, start: int) -> Chunk:
        """The chunk that begins with this measurement."""
        return Chunk(int(start), min(int(start) + self.size, self.source.count))

    def chunks(self) -> Iterator[Chunk]:
        """All chunks in order."""
        return map(self.chunk, range(0, self.source.count, self.size))

    def around(self, chunk: Chunk, preview: bool = False) -> Chunk:
        """What must be read to solve a chunk: of a sequence also its neighbours."""
        beside = 1 if self.sequence and not preview else 0
        return Chunk(max(chunk.start - beside, 0), min(chunk.stop + beside, self.source.count))


def part_of(options: dict[str, Any], where: int | slice) -> dict[str, Any]:
    """Options for some of the measurements: what is given for each of them is cut.

    >>> part_of({"bad": np.zeros((5, 2, 2), bool), "tol": 0.0}, slice(1, 3))["bad"].shape
    (2, 2, 2)
    """
    return {name: value[where] if _of_each(name, value) else value for name, value in options.items()}


def _of_each(name: str, value: Any) -> bool:
    return getattr(value, "ndim", 0) == EACH.get(name, -1)
