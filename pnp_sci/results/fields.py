"""The fields of a result, and what follows from them alone."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from pnp_sci.errors import InputError
from pnp_sci.formats.brightness import brightest
from pnp_sci.results.history import History, Status
from pnp_sci.results.words import counted


@dataclass(frozen=True, eq=False, repr=False)
class Fields:
    """What :class:`pnp_sci.Result` holds: see there."""

    x: np.ndarray
    status: Status
    history: History
    settings: dict[str, Any]
    scenes: list[dict[str, Any]] = field(default_factory=list)
    uncertainty: np.ndarray | None = None

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.x, dtype) if copy else np.asarray(self.x, dtype)

    def __len__(self) -> int:
        """The number of measurements."""
        return len(self.videos)

    @property
    def videos(self) -> np.ndarray:
        """The videos of all measurements, (N, V, B, H, W), in colour (N, V, B, H, W, 3)."""
        return self.x if self._several else self.x[None]

    @property
    def in_colour(self) -> bool:
        """Whether the last axis of the videos is red, green and blue: ``settings["mosaic"]`` says so."""
        return bool(self.settings.get("mosaic"))

    @property
    def _several(self) -> bool:
        return self.x.ndim == 5 + self.in_colour

    @property
    def white(self) -> float:
        """The value shown as white: ``settings["peak"]`` if there is one, else the 99.9th percentile of x."""
        peak = self.settings.get("peak")
        return float(peak) if peak else brightest(self.x)

    @property
    def scene(self) -> dict[str, Any]:
        """What was found of the scene of the only measurement, see `scenes`.

        Raises
        ------
        InputError
            If there are several measurements.
        """
        if len(self.scenes) > 1:
            raise InputError(f"scene: the result has {len(self.scenes)} measurements: scenes[n] was expected")
        return self.scenes[0] if self.scenes else {}

    @property
    def remarks(self) -> list[str]:
        """What to know before the result is used, a sentence each: parts not modelled, and faults of the measurement.

        They are the entries "remarks" of `scenes`; of several measurements it is said which they concern.
        """
        concerned: dict[str, list[int]] = {}
        for n, scene in enumerate(self.scenes):
            for remark in scene.get("remarks", []):
                concerned.setdefault(remark, []).append(n)
        count = len(self.scenes)
        return [text if len(ns) == count else f"measurement {counted(ns)}: {text}" for text, ns in concerned.items()]
