"""Zarr v3 stores as arrays: a folder with a chunk a file. The image has the metadata of OME-Zarr 0.5."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError

AXES = {"t": "time", "c": "channel", "y": "space", "x": "space"}  # OME-Zarr wants time first
MARK = "pnp_sci"  # attribute of the stores that this package writes
Named = tuple[np.ndarray, tuple[str, ...], tuple[int, ...]]  # array, names of its dimensions, shape of a chunk


def library() -> Any:
    """The package, or an error that names the extra."""
    with needed_for("a .zarr store", "zarr"):
        import zarr
    return zarr


def is_store(path: Path) -> bool:
    """Whether a folder is an array or a group of Zarr, v2 or v3."""
    return any((path / name).is_file() for name in ("zarr.json", ".zarray", ".zgroup"))


def save(path: Path, arrays: Mapping[str, Named], texts: Mapping[str, Any]) -> None:
    """Write a group of arrays with `texts` as attribute; "video", of axes (t, c, y, x), is the image of OME-Zarr."""
    attributes = {MARK: dict(texts), "ome": ome("video", "video")}
    group = library().open_group(path, mode="w-", zarr_format=3, attributes=attributes)
    for name, (array, dims, chunk) in arrays.items():
        made = group.create_array(
            name,
            shape=array.shape,
            chunks=chunk,
            dtype=array.dtype,
            dimension_names=dims,
            fill_value=0,
            config={"write_empty_chunks": True},  # all chunks are written: a missing one is an error
        )
        if array.size:
            made[...] = array


def texts_of(path: Path) -> dict[str, Any]:
    """The texts of a result that :func:`save` wrote; no array is read.

    Raises
    ------
    FormatError
        If the folder is something else.
    """
    try:
        texts = dict(json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"][MARK])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise FormatError("it is a store of other software") from error
    if "status" not in texts:
        raise FormatError("it has no status; pnp_sci.Reconstruction opens what pnp_sci.reconstruct has written")
    return texts


def load(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """The arrays of a store that :func:`save` wrote, and its texts.

    Raises
    ------
    FormatError
        If a chunk is missing, which Zarr would read as zeros.
    """
    texts = texts_of(path)
    group = library().open_group(path, mode="r")
    for name, item in group.arrays():
        if item.size and (lost := item.nchunks - item.nchunks_initialized):
            raise FormatError(f"{lost} of the {item.nchunks} chunks of {name} are missing: copy the whole folder again")
    return {name: np.asarray(item[...]) for name, item in group.arrays()}, texts


def ome(name: str, path: str) -> dict[str, Any]:
    """The metadata of an image of this name, whose array is at `path` in its group."""
    image = {
        "name": name,
        "axes": [{"name": axis, "type": kind} for axis, kind in AXES.items()],
        "datasets": [{"path": path, "coordinateTransformations": [{"type": "scale", "scale": [1.0] * len(AXES)}]}],
    }
    return {"version": "0.5", "multiscales": [image]}
