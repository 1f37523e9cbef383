"""Measurements on disk or in memory, of which only those that are asked for are read."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci import io
from pnp_sci._validate import real_array
from pnp_sci.camera.calibration import Calibration
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.fleet import readers
from pnp_sci.formats.arrays import READABLE
from pnp_sci.formats.pictures import numbered
from pnp_sci.formats.plain import some
from pnp_sci.formats.zarr import is_store

SUFFIXES = {*readers.IN_PARTS, *READABLE}

_log = logging.getLogger("pnp_sci")


@dataclass(frozen=True, eq=False)
class Source:
    """N measurements of equal size.

    Attributes
    ----------
    count : int
        N.
    shape : (int, int)
        Rows and columns.
    dtype : numpy.dtype
    read : callable
        ``read(start, stop)`` returns measurements `start` to `stop` - 1, (n, H, W).
    travels : bool
        Whether a worker can read by itself. Else the client reads and sends what a chunk needs, and `read` is None on
        workers.
    """

    count: int
    shape: tuple[int, int]
    dtype: np.dtype
    read: Any
    travels: bool


def open_source(source: Any, key: str | None = None) -> Source:
    """Open a source of N measurements (H, W) without reading it.

    Parameters
    ----------
    source : path, sequence of paths, or array-like (N, H, W) or (H, W)
        A zarr array, HDF5, NPY or TIFF is read in parts, a folder or a list file by file; of other formats that
        :func:`pnp_sci.io.read` knows, a file is read at once.
    key : str, optional
        Name of the array in a file or a group that has several.

    Raises
    ------
    FileNotFoundError, FormatError
        If a file is missing or cannot be understood.
    InputError, InputTypeError
        If it is not an array of measurements.
    """
    if isinstance(source, (str, Path)):
        return _of_path(Path(source).resolve(), key)
    if isinstance(source, (list, tuple)) and source and all(isinstance(file, (str, Path)) for file in source):
        return _joined([Path(file).resolve() for file in source], key)
    if (npy := readers.of_memmap(source)) is not None:
        return _of_path(npy, None)
    if (h5 := readers.of_hdf5(source)) is not None:
        return _of_path(h5[0], h5[1])
    if (zarr := readers.of_zarr(source)) is not None:
        return _measurements("source", source, zarr)
    if not (hasattr(source, "shape") and hasattr(source, "dtype") and hasattr(source, "__getitem__")):
        source = real_array("source", source)
    return _measurements("source", source, partial(readers.part, source), travels=readers.is_stored(source))


def corrected(source: Source, calibration: Calibration) -> Source:
    """The measurements that a calibration makes of a source of raw pictures."""
    calibration.cropped("source", np.broadcast_to(0, source.shape))  # raises an error for another size
    read = partial(_corrected, source.read, calibration)
    return replace(source, shape=calibration.bad.shape, dtype=calibration.dark.dtype, read=read)


def _corrected(read: readers.Reader, calibration: Calibration, start: int, stop: int) -> np.ndarray:
    raw = read(start, stop)
    y = calibration.correct(raw)
    y.data[~raw.any((1, 2))] = 0  # a picture that is missing stays one
    return y


def _measurements(name: str, array: Any, reader: readers.Reader, travels: bool = True) -> Source:
    """A source of an array-like (N, H, W) or (H, W); `reader` takes care of the latter."""
    shape, dtype = tuple(int(length) for length in array.shape), np.dtype(array.dtype)
    if dtype.kind not in "biuf":
        raise InputTypeError(f"{name} has dtype {dtype}: real numbers were expected")
    if len(shape) not in (2, 3) or 0 in shape:
        raise InputError(f"{name} has shape {shape}: (measurements, rows, columns) or (rows, columns) was expected")
    count, rows, columns = shape if len(shape) == 3 else (1, *shape)
    return Source(count, (rows, columns), dtype, reader, travels)


def _of_path(path: Path, key: str | None) -> Source:
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file or folder")
    if path.is_dir() and not is_store(path):
        return _joined(_files_in(path), key)
    suffix = ".zarr" if path.is_dir() else path.suffix.lower()
    if suffix not in readers.IN_PARTS:
        return _measurements(str(path), _whole(path, key, *_stamp(path)), partial(_of_whole, path, key))
    try:
        head, reader = readers.IN_PARTS[suffix](path, key)
    except (FormatError, ImportError, PermissionError):
        raise
    except Exception as error:  # each library has its own exceptions for a damaged file
        raise FormatError(f"{path} cannot be read, it may be damaged: {error}") from error
    return _measurements(str(path), head, reader)


def _files_in(folder: Path) -> list[Path]:
    """The files of a folder whose formats are known, in the order of the numbers in their names."""
    files = sorted((f for f in folder.iterdir() if f.is_file() and f.name[0] != "."), key=numbered)
    known, others = [], []
    for file in files:
        (known if file.suffix.lower() in SUFFIXES else others).append(file)
    if not known:
        raise FormatError(f"{folder}: the folder has no files of these kinds: {', '.join(sorted(SUFFIXES))}")
    if others:
        shown = some([file.name for file in others], 5)
        _log.warning("%s: these files are no measurements, and are left out: %s", folder, shown)
    return known


def _stamp(path: Path) -> tuple[int, int]:
    """Time of the last change, and bytes: a cache must not outlive them."""
    state = path.stat()
    return state.st_mtime_ns, state.st_size


@lru_cache(maxsize=1)
def _whole(path: Path, key: str | None, changed: int, size: int) -> np.ndarray:
    return io.read_measurement(path, key)


def _of_whole(path: Path, key: str | None, start: int, stop: int) -> np.ndarray:
    return readers.part(_whole(path, key, *_stamp(path)), start, stop)


@lru_cache(maxsize=1)
def _opened(path: Path, key: str | None, changed: int, size: int) -> Source:
    return _of_path(path, key)


@dataclass(frozen=True, eq=False)
class _Files:
    """Files one after the other; `ends[k]` is the number of measurements in the first k + 1."""

    paths: Sequence[Path]
    ends: np.ndarray
    key: str | None
    shape: tuple[int, int]

    def __call__(self, start: int, stop: int) -> np.ndarray:
        parts = []
        while start < stop:
            k = int(np.searchsorted(self.ends, start, side="right"))
            first = int(self.ends[k - 1]) if k else 0
            upto = min(stop, int(self.ends[k]))
            one = _opened(self.paths[k], self.key, *_stamp(self.paths[k]))
            _same_size(self.paths[k], one, self.shape)
            if one.count != self.ends[k] - first:
                counted = f"{self.ends[k] - first} when the files were counted"
                raise FormatError(f"{self.paths[k]}: {one.count} measurements, but {counted}")
            parts.append(one.read(start - first, upto - first))
            start = upto
        return np.concatenate(parts) if len(parts) > 1 else parts[0]


def _joined(paths: list[Path], key: str | None) -> Source:
    """All files one after the other; one that cannot be read counts as one measurement, which fails in its turn."""
    first, counts, errors = None, [], []
    for path in paths:
        try:
            one = _of_path(path, key)
        except (FileNotFoundError, PermissionError):
            raise
        except (FormatError, OSError) as error:  # damaged, or on a disk that is away for a moment
            errors.append(error)
            counts.append(1)
            continue
        first = first or one
        _same_size(path, one, first.shape)
        _alone(path, one, len(paths))
        counts.append(one.count)
    if first is None:
        raise errors[0]
    ends = np.cumsum(counts)
    return Source(int(ends[-1]), first.shape, first.dtype, _Files(tuple(paths), ends, key, first.shape), True)


def _alone(path: Path, one: Source, files: int) -> None:
    """Raise an error for a file, among others, that stands for pictures of several files: they would count again."""
    if files > 1 and getattr(one.read, "elsewhere", False):
        raise InputError(f"source: {path} also stands for the pictures of other files: give it alone, not its folder")


def _same_size(path: Path, one: Source, shape: tuple[int, int]) -> None:
    if one.shape != shape:
        raise InputError(f"source: {path} has pictures of {one.shape}, but others have {shape}: the same was expected")
