"""The result on disk: OME-Zarr 0.5, masks and records of the measurements beside the videos."""

from __future__ import annotations

import errno
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np
from filelock import FileLock, Timeout

from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.plain import as_json, finite
from pnp_sci.formats.replacing import replacing
from pnp_sci.formats.zarr import AXES, MARK, library, ome

VIDEO, ERRORS, MASKS, RECORDS = "0", "uncertainty", "masks", "records"
FORMAT = 1  # of records and settings


def create(path: Path, masks: np.ndarray, settings: dict[str, Any], uncertainty: bool) -> None:
    """Make an empty result, whole or not at all; pixels that are not solved are NaN.

    Frames of all measurements follow one another: OME-Zarr has one axis of time. A chunk is a measurement and view.
    """
    views, frames, rows, columns = masks.shape
    with replacing(path) as temporary:
        attributes = {"ome": ome(path.stem, VIDEO), MARK: {"format": FORMAT, "settings": settings}}
        group = library().create_group(temporary, attributes=attributes)
        for name in (VIDEO, ERRORS) if uncertainty else (VIDEO,):
            group.create_array(
                name,
                shape=(settings["measurements"] * frames, views, rows, columns),
                chunks=(frames, 1, rows, columns),
                dtype=settings["dtype"],
                fill_value=float("nan"),
                dimension_names=list(AXES),
            )
        group.create_array(MASKS, data=masks, dimension_names=["c", "frame", "y", "x"])
        group.create_group(RECORDS)


def settings_in(path: Path) -> dict[str, Any]:
    """The settings of an existing result.

    Raises
    ------
    FormatError
        If it is none.
    """
    try:
        attributes = json.loads((path / "zarr.json").read_text(encoding="utf-8"))["attributes"][MARK]
        if attributes["format"] > FORMAT:
            raise FormatError(f"{path} has format {attributes['format']}, {FORMAT} at most was expected")
        return attributes["settings"]
    except (OSError, KeyError, TypeError, json.JSONDecodeError) as error:
        raise FormatError(f"{path} is no result of pnp-sci reconstruct: another place was expected") from error


def check_same(path: Path, settings: dict[str, Any]) -> None:
    """Raise an InputError that says in what the settings of an existing result differ."""
    there, here = (_flat(json.loads(json.dumps(s))) for s in (settings_in(path), settings))
    differ = [name for name in sorted({*there, *here}) if there.get(name) != here.get(name)]
    if differ:
        said = "; ".join(f"{n} {there.get(n, 'by default')!r} there, {here.get(n, 'by default')!r} now" for n in differ)
        raise InputError(f"out is {path}, a result of other settings ({said}): the same or another place was expected")


def _flat(settings: dict[str, Any]) -> dict[str, Any]:
    """Options and versions beside the other settings."""
    nested = {name: value for name, value in settings.items() if isinstance(value, dict)}
    return {k: v for k, v in settings.items() if k not in nested} | {
        f"{name} {key}": value for name, group in nested.items() for key, value in group.items()
    }


@contextmanager
def only_run(path: Path) -> Iterator[None]:
    """Context in which no other run may write to this folder, which need not exist. The lock ends with its process.

    Raises
    ------
    InputError
        If another run does.
    """
    try:
        lock = FileLock(path.with_name(f".{path.name[:200]}.lock")).acquire(timeout=0)
    except Timeout as error:
        said = f"out is {path}, where another run is writing: another place was expected, or to wait for its end"
        raise InputError(said) from error
    except OSError as error:
        raise OSError(error.errno or errno.EIO, "the lock beside it cannot be written", str(path)) from error
    with lock:
        yield


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Context in which an error of the disk names the result, and says how to go on."""
    try:
        yield
    except OSError as error:
        said = f"{error.strerror or error}; what is done stays, the same call goes on with it"
        raise OSError(error.errno or errno.EIO, said, str(path)) from error


def show_white(path: Path, white: float) -> None:
    """Tell viewers how the views are called and which value is white, atomically."""
    file = path / "zarr.json"
    whole = json.loads(file.read_text(encoding="utf-8"))
    views = json.loads((path / VIDEO / "zarr.json").read_text(encoding="utf-8"))["shape"][1]
    window = {"min": 0.0, "max": white, "start": 0.0, "end": white}
    whole["attributes"]["ome"]["omero"] = {
        "channels": [
            {"label": f"view {v + 1}", "color": "FFFFFF", "active": True, "window": window} for v in range(views)
        ]
    }
    _write(file, whole)


def put_videos(path: Path, start: int, videos: np.ndarray, name: str = VIDEO) -> None:
    """Write the videos (n, V, B, H, W) of measurements from `start` on, whose earlier records must be gone."""
    array = library().open_array(path, path=name, mode="r+")
    frames = videos.shape[2]
    for n, video in enumerate(videos, start):
        array[n * frames : (n + 1) * frames] = video.swapaxes(0, 1)


def clear(path: Path, start: int, stop: int) -> None:
    """Remove records, and then videos and predicted errors, of measurements."""
    for n in range(start, stop):
        _record(path, n).unlink(missing_ok=True)
    group = library().open_group(path, mode="r+")
    frames = group[MASKS].shape[1]
    for name in {VIDEO, ERRORS} & set(group.array_keys()):
        group[name][start * frames : stop * frames] = np.nan


def put_record(path: Path, n: int, record: dict[str, Any]) -> None:
    """Write the record of a measurement, atomically: its videos must have been written."""
    _write(_record(path, n), record)


def record(path: Path, n: int) -> dict[str, Any] | None:
    """The record of a measurement, None if there is none."""
    try:
        return json.loads(_record(path, n).read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None


def stored_bytes(path: Path, n: int, arrays: tuple[str, ...]) -> int:
    """Bytes on disk of a measurement."""
    files = [file for name in arrays for file in (path / name / "c" / str(n)).rglob("*") if file.is_file()]
    return sum(file.stat().st_size for file in [*files, _record(path, n)])


def sweep(path: Path) -> None:
    """Remove what a killed process left half written."""
    arrays = ((path / name).rglob("*.partial") for name in (VIDEO, ERRORS))  # names of zarr
    for left in chain(path.glob(".*"), (path / RECORDS).glob(".*"), *arrays):
        if left.is_file():
            left.unlink(missing_ok=True)


def _record(path: Path, n: int) -> Path:
    return path / RECORDS / f"{n:07d}.json"


def _write(file: Path, content: dict[str, Any]) -> None:
    temporary = file.parent / f".{uuid4().hex[:12]}"
    temporary.write_text(as_json(finite(content), indent=1), encoding="utf-8")
    os.replace(temporary, file)
