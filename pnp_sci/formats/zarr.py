"""Zarr v3 stores as arrays: a folder with a chunk a file. The image has the metadata of OME-Zarr 0.5."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for

AXES = "t", "c", "y", "x"  # OME-Zarr wants time first
MARK = "pnp_sci"  # attribute of the stores that this package writes, which it may replace
Named = tuple[np.ndarray, tuple[str, ...], tuple[int, ...]]  # array, names of its dimensions, shape of a chunk


def library() -> Any:
    """The package, or an error that names the extra."""
    with needed_for("a .zarr store", "zarr"):
        import zarr
    return zarr


def save(path: Path, arrays: Mapping[str, Named], texts: Mapping[str, Any]) -> None:
    """Write a group of arrays with `texts` as attribute; "video", of axes (t, c, y, x), is the image of OME-Zarr."""
    group = library().open_group(path, mode="w-", zarr_format=3, attributes={MARK: dict(texts), "ome": _ome()})
    for name, (array, dims, chunk) in arrays.items():
        made = group.create_array(
            name, shape=array.shape, chunks=chunk, dtype=array.dtype, dimension_names=dims, fill_value=0
        )
        if array.size:
            made[...] = array


def load(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays of a store that :func:`save` wrote, and its texts."""
    group = library().open_group(path, mode="r")
    return {name: np.asarray(item[...]) for name, item in group.arrays()}, dict(group.attrs[MARK])


def _ome() -> dict[str, Any]:
    kinds = "time", "channel", "space", "space"
    image = {
        "name": "video",
        "axes": [{"name": name, "type": kind} for name, kind in zip(AXES, kinds)],
        "datasets": [{"path": "video", "coordinateTransformations": [{"type": "scale", "scale": [1.0] * len(AXES)}]}],
    }
    return {"version": "0.5", "multiscales": [image]}
