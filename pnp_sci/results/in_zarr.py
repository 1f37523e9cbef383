"""A result as a Zarr store, which xarray and viewers of OME-Zarr can open."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.formats import zarr

NAMES = {"x": "video", "uncertainty": "uncertainty"}  # xarray knows no variable x beside an axis x


def write(path: Path, arrays: dict[str, np.ndarray], texts: dict[str, str]) -> None:
    """One chunk a measurement and view: the frames of one after the other, (N * B, V, H, W)."""
    x, history = arrays["x"], arrays["history"]
    views, frames, rows, columns = x.shape[-4:]

    def film(a: np.ndarray) -> zarr.Named:
        times_first = a.reshape(-1, *x.shape[-4:]).swapaxes(1, 2).reshape(-1, views, rows, columns)
        return times_first, tuple(zarr.AXES), (frames, 1, rows, columns)

    stored = {"history": (history, ("record", "field"), (max(len(history), 1), history.shape[1]))}
    stored |= {name_there: film(arrays[name]) for name, name_there in NAMES.items() if name in arrays}
    zarr.save(path, stored, texts | {"shape": json.dumps(x.shape)})


def read(path: Path) -> Mapping[str, Any]:
    """What :func:`write` wrote."""
    arrays, texts = zarr.load(path)
    shape = json.loads(texts["shape"])
    views, frames, rows, columns = shape[-4:]
    films = {
        name: np.ascontiguousarray(arrays[key].reshape(-1, frames, views, rows, columns).swapaxes(1, 2)).reshape(shape)
        for name, key in NAMES.items()
        if key in arrays
    }
    return {"history": arrays["history"]} | films | texts
