"""Measurements on disk or in memory, of which only those that are asked for are read."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci import io
from pnp_sci._validate import real_array
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.fleet import readers

Reader = Callable[[int, int], np.ndarray]


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
        Whether a worker can read by itself; else the client reads and sends what a chunk needs.
    """

    count: int
    shape: tuple[int, int]
    dtype: np.dtype
    read: Reader
    travels: bool


def open_source(source: Any, key: str | None = None) -> Source:
    """What stands for N measurements (H, W), opened but not read.

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
    if isinstance(source, np.memmap) and source.base is not None and Path(str(source.filename)).suffix == ".npy":
        whole = _of_path(Path(str(source.filename)), None)
        if whole.count == len(source) and source.ndim == 3:  # not a part of the file
            return whole
    if (h5 := readers.of_hdf5(source)) is not None:
        return _of_path(h5[0], h5[1])
    if not (hasattr(source, "shape") and hasattr(source, "dtype") and hasattr(source, "__getitem__")):
        source = real_array("source", source)
    return _measurements("source", source, readers.Whole(source), travels=readers.is_stored(source))


def _measurements(name: str, array: Any, reader: Reader, travels: bool = True) -> Source:
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
    if path.is_dir() and not readers.is_zarr(path):
        files = [f for f in path.iterdir() if f.is_file() and f.name[0] != "."]
        if not files:
            raise FormatError(f"{path}: the folder has no files")
        return _joined(sorted(files, key=_numbered), key)
    suffix = ".zarr" if path.is_dir() else path.suffix.lower()
    if suffix not in readers.IN_PARTS:
        array = _whole(path, key)
        return _measurements(str(path), array, _WholeFile(path, key))
    try:
        head, reader = readers.IN_PARTS[suffix](path, key)
    except (FormatError, ImportError, PermissionError):
        raise
    except Exception as error:  # each library has its own exceptions for a damaged file
        raise FormatError(f"{path} cannot be read, it may be damaged: {error}") from error
    return _measurements(str(path), head, reader)


@lru_cache(maxsize=1)
def _whole(path: Path, key: str | None) -> np.ndarray:
    return io.read_measurement(path, key)


@dataclass(frozen=True)
class _WholeFile:
    """Of a format that is read at once."""

    path: Path
    key: str | None

    def __call__(self, start: int, stop: int) -> np.ndarray:
        array = _whole(self.path, self.key)
        return (array if array.ndim == 3 else array[None])[start:stop]


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
            one = _of_path(self.paths[k], self.key)
            _same_size(self.paths[k], one, self.shape)
            parts.append(one.read(start - first, upto - first))
            start = upto
        return np.concatenate(parts) if len(parts) > 1 else parts[0]


def _joined(paths: list[Path], key: str | None) -> Source:
    first = _of_path(paths[0], key)
    counts = [first.count]
    for path in paths[1:]:
        try:
            one = _of_path(path, key)
        except FormatError:  # a damaged file counts as one measurement, which fails when its turn comes
            counts.append(1)
            continue
        _same_size(path, one, first.shape)
        counts.append(one.count)
    ends = np.cumsum(counts)
    return Source(int(ends[-1]), first.shape, first.dtype, _Files(tuple(paths), ends, key, first.shape), True)


def _same_size(path: Path, one: Source, shape: tuple[int, int]) -> None:
    if one.shape != shape:
        raise InputError(
            f"source: {path} has pictures of {one.shape}, but the first file of {shape}: the same was expected"
        )


def _numbered(path: Path) -> list[Any]:
    """Sort key: numbers in names count as numbers."""
    return [int(p) if n % 2 else p for n, p in enumerate(re.split(r"([0-9]+)", path.name))]
