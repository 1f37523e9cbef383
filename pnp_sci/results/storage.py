"""Results in files: NPZ, HDF5, MAT or Zarr, arrays beside JSON, nothing pickled."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, MissingExtraError
from pnp_sci.formats import hdf5, mat, npz
from pnp_sci.formats.channels import as_channels, in_colour
from pnp_sci.formats.child import apart
from pnp_sci.formats.plain import as_json
from pnp_sci.formats.replacing import replacing
from pnp_sci.results import in_zarr
from pnp_sci.results.history import History, Status

Arrays = dict[str, np.ndarray]
Texts = dict[str, str]
VIDEOS = "x", "uncertainty"

_EARLIER_STATUSES = {  # sentences of version 0.1.0
    "the residual grew: the best iterate before that is returned": Status.DIVERGED,
    "an iterate was not finite: the last finite one is returned": Status.NOT_FINITE,
}


def save(
    path: Path,
    x: np.ndarray,
    status: Status,
    history: History,
    settings: dict,
    scenes: list[dict],
    uncertainty: np.ndarray | None = None,
) -> None:
    """Write the fields of a result whole, or not at all."""
    _check_suffix(path)
    arrays = {"x": x, "history": history.table()}
    if uncertainty is not None:
        arrays["uncertainty"] = uncertainty
    texts = {
        "status": status.value,
        "history_columns": json.dumps(History.names),
        "settings": as_json(settings),
        "scenes": as_json(scenes),
    }
    with replacing(path) as temporary:
        _WRITERS[path.suffix.lower()](temporary, arrays, texts)


def load(path: Path) -> dict[str, Any]:
    """The fields of a result from a file.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    FormatError
        If it is damaged or not a result.
    """
    _check_suffix(path)
    if not (path.is_dir() if path.suffix.lower() == ".zarr" else path.is_file()):
        raise FileNotFoundError(f"{path}: there is no such file")
    try:
        return _fields(_READERS[path.suffix.lower()](path))
    except MissingExtraError:
        raise
    except KeyError as error:
        raise FormatError(f"{path} cannot be read as a result, as it holds none: {error.args[0]}") from error
    except Exception as error:  # each library has its own exceptions for a damaged file
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise FormatError(f"{path} cannot be read as a result: {reason}") from error


def _fields(parts: Mapping[str, Any]) -> dict[str, Any]:
    settings, x, status = json.loads(str(parts["settings"])), parts["x"], str(parts["status"])
    colour = bool(settings.get("mosaic")) if isinstance(settings, dict) else False
    scenes = json.loads(str(parts["scenes"])) if "scenes" in parts else _earlier_scenes(parts["scene"])
    if (
        x.ndim - colour not in (4, 5)
        or x.dtype.kind != "f"
        or not (isinstance(settings, dict) and isinstance(scenes, list))
    ):
        raise FormatError(f"x is {x.dtype} {x.shape}, settings and scenes are {settings!r:.40} and {scenes!r:.40}")
    return {
        "x": x,
        "status": _EARLIER_STATUSES.get(status) or Status(status),
        "history": History.from_table(parts["history"]),
        "settings": settings,
        "scenes": [_as_described(scene) for scene in scenes],
        "uncertainty": _errors_of(x, parts.get("uncertainty")),
    }


def _as_described(scene: dict[str, Any]) -> dict[str, Any]:
    """A scene with the tuples of a :class:`~pnp_sci.SceneModel`, for which JSON has lists."""
    return scene | {name: tuple(scene[name]) for name in ("views", "still") if isinstance(scene.get(name), list)}


def _errors_of(x: np.ndarray, errors: np.ndarray | None) -> np.ndarray | None:
    """The predicted errors of x, where the file holds any."""
    if errors is not None and (errors.shape != x.shape or errors.dtype.kind != "f"):
        raise FormatError(f"uncertainty is {errors.dtype} {errors.shape}: the shape of x {x.shape} was expected")
    return errors


def _earlier_scenes(text: Any) -> list[dict[str, Any]]:
    """Older files hold the scene of one measurement, or those of several as "measurements"."""
    scene = json.loads(str(text))
    if not isinstance(scene, dict):
        raise FormatError(f"scene is {scene!r:.40}")
    return scene.get("measurements", [scene] if scene else [])


def _check_suffix(path: Path) -> None:
    if path.suffix.lower() not in SUFFIXES:
        raise FormatError(f"{path}: a result is kept in {', '.join(SUFFIXES)}, but {path.suffix or 'no suffix'} came")


def _write_npz(path: Path, arrays: Arrays, texts: Texts) -> None:
    npz.save(path, arrays | {key: np.array(text) for key, text in texts.items()}, packed=False)


def _read_npz(path: Path) -> Mapping[str, Any]:
    if not zipfile.is_zipfile(path):  # of anything else numpy advises to unpickle it
        raise FormatError("it is no NPZ archive, or it is truncated")
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        needed = {name: file[name] for name in ("status", "settings", "history", "x")}  # videos last: others have them
        return needed | {name: file[name] for name in ("scenes", "scene", "uncertainty") if name in file}


def _write_hdf5(path: Path, arrays: Arrays, texts: Texts) -> None:
    with hdf5.creating(path) as file:
        for name, array in arrays.items():
            file[name] = array
        file.attrs.update(texts)


def _read_hdf5(path: Path) -> Mapping[str, Any]:
    hdf5.h5py()
    parts = apart(lambda: _parts(path), path.stat().st_size)
    return {key: part.tobytes().decode() if part.dtype == np.uint8 else part for key, part in parts.items()}


def _in_colour(texts: Mapping[str, Any]) -> bool:
    return bool(json.loads(str(texts["settings"])).get("mosaic"))


def _parts(path: Path) -> dict[str, np.ndarray]:
    """Arrays and, as bytes, texts."""
    with hdf5.opened(path) as file:
        if "status" not in file.attrs:
            raise FormatError("it has no status")
        texts = {key: np.frombuffer(str(text).encode(), np.uint8) for key, text in file.attrs.items()}
        return texts | {key: np.asarray(file[key]) for key in (*VIDEOS, "history") if key in file}


def _changed(parts: Mapping[str, Any], change: Callable[[np.ndarray], np.ndarray]) -> dict[str, Any]:
    """The parts with other axes of all that is shaped like the video."""
    return {**parts, **{name: change(parts[name]) for name in VIDEOS if name in parts}}


def _write_mat(path: Path, arrays: Arrays, texts: Texts) -> None:
    if _in_colour(texts):  # rows and columns first in MATLAB, then colours
        arrays = _changed(arrays, lambda video: np.moveaxis(video, -1, -3))
    mat.save(path, arrays, texts | {"shape": json.dumps(arrays["x"].shape)})


def _read_mat(path: Path) -> Mapping[str, Any]:
    """MATLAB drops last axes of length 1, which are our first ones."""
    texts = mat.load_texts(path)
    shape = json.loads(texts["shape"])
    arrays = _changed(mat.load(path), lambda video: np.ascontiguousarray(video).reshape(shape))
    if _in_colour(texts):
        arrays = _changed(arrays, lambda video: np.moveaxis(video, -3, -1))
    return arrays | texts


def _write_zarr(path: Path, arrays: Arrays, texts: Texts) -> None:
    in_zarr.write(path, _changed(arrays, as_channels) if _in_colour(texts) else arrays, texts)


def _read_zarr(path: Path) -> Mapping[str, Any]:
    parts = in_zarr.read(path)
    return _changed(parts, in_colour) if _in_colour(parts) else parts


_WRITERS: dict[str, Callable[[Path, Arrays, Texts], None]] = {
    ".npz": _write_npz,
    **dict.fromkeys((".h5", ".hdf5"), _write_hdf5),
    ".mat": _write_mat,
    ".zarr": _write_zarr,
}
_READERS: dict[str, Callable[[Path], Mapping[str, Any]]] = {
    ".npz": _read_npz,
    **dict.fromkeys((".h5", ".hdf5"), _read_hdf5),
    ".mat": _read_mat,
    ".zarr": _read_zarr,
}
SUFFIXES = tuple(_WRITERS)
