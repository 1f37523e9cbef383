"""Formats that are read in parts. For each: an array-like that knows its shape and dtype, and a reader of its parts.

A reader can be pickled. ``reader(start, stop)`` returns measurements `start` to `stop` - 1, (n, H, W).
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pnp_sci.errors import FormatError
from pnp_sci.formats.hdf5 import opened, others_of
from pnp_sci.formats.npz import mapped
from pnp_sci.formats.tiff import check_as_displayed, decoding
from pnp_sci.formats.zarr import library

_log = logging.getLogger("pnp_sci")
Reader = Callable[[int, int], np.ndarray]
NAMES = ("meas", "y", "measurement")  # of measurements, where a file has several arrays


class Head(NamedTuple):
    """What is known of an array before it is read."""

    shape: tuple[int, ...]
    dtype: np.dtype


def part(array: Any, start: int, stop: int) -> np.ndarray:
    """Measurements `start` to `stop` - 1 of an array-like (N, H, W) or (H, W), as (n, H, W); masked if that is."""
    read = np.asanyarray(array[start:stop] if len(array.shape) == 3 else array[...])
    read = read if isinstance(read, np.ma.MaskedArray) else np.asarray(read)
    return read if len(array.shape) == 3 else read[None]


def npy(path: Path, key: str | None) -> tuple[Head, Reader]:
    """An NPY file, which is mapped into memory."""
    array = mapped(path)
    return Head(array.shape, array.dtype), partial(_of_npy, path)


def _of_npy(path: Path, start: int, stop: int) -> np.ndarray:
    return np.array(part(mapped(path), start, stop))


def of_memmap(source: Any) -> Path | None:
    """The NPY file that an array is, as it is on disk; None of a part, of other axes, or of a copy with changes."""
    path = Path(str(getattr(source, "filename", "")))
    if not isinstance(source, np.memmap) or source.mode == "c" or path.suffix != ".npy" or not path.is_file():
        return None
    try:
        there = mapped(path)
    except FormatError:  # it has no head: a file of another format
        return None
    same = all(getattr(source, name) == getattr(there, name) for name in ("offset", "shape", "strides", "dtype"))
    return path if same else None


def hdf5(path: Path, key: str | None) -> tuple[Head, Reader]:
    """A dataset of an HDF5 file."""
    with opened(path) as file:
        found: dict[str, Head] = {}
        file.visititems(lambda name, item: found.update(_head(name, item)))
        name = chosen(path, found, key)
        others_of(name, file[name])
    return found[name], partial(_of_dataset, path, name)


def _of_dataset(path: Path, key: str, start: int, stop: int) -> np.ndarray:
    with opened(path) as file:
        others_of(key, file[key])
        return part(file[key], start, stop)


def of_hdf5(source: Any) -> tuple[Path, str] | None:
    """File and name of an open dataset; None of anything else."""
    if type(source).__module__.partition(".")[0] != "h5py" or not hasattr(source, "file"):
        return None
    return Path(source.file.filename).resolve(), source.name.lstrip("/")


def in_zarr(path: Path, key: str | None) -> tuple[Head, Reader]:
    """An array in zarr's folder, itself or in a group."""
    node = library().open(path, mode="r")
    if not hasattr(node, "array_keys"):
        _warn_of_gaps(path, node)
        return Head(node.shape, node.dtype), partial(_of_folder, path, "")
    found = dict(
        pair
        for name, item in sorted(node.members(max_depth=None), key=lambda member: member[0])
        for pair in _head(name, item).items()
    )
    name = chosen(path, found, key)
    _warn_of_gaps(path, node[name])
    return found[name], partial(_of_folder, path, name)


def _of_folder(path: Path, key: str, start: int, stop: int) -> np.ndarray:
    return part(library().open_array(path, path=key, mode="r"), start, stop)


def _warn_of_gaps(path: Path, array: Any) -> None:
    """Say how many chunks are not stored: zarr leaves out those of one value, and reads a lost one as such."""
    if gaps := array.nchunks - array.nchunks_initialized:
        said = "%s: %d of %d chunks are not stored, and read as %s: the folder may be incomplete"
        _log.warning(said, path, gaps, array.nchunks, array.fill_value)


def of_zarr(source: Any) -> Reader | None:
    """The reader of an open array that is in a folder; None of anything else."""
    place: Any = getattr(source, "store_path", None)
    root = getattr(getattr(place, "store", None), "root", None)
    return partial(_of_folder, root.resolve(), place.path) if isinstance(root, Path) else None


def is_stored(array: Any) -> bool:
    """Whether an array-like carries the address of its values, not the values: it can be sent to a worker."""
    store = getattr(getattr(array, "store_path", None), "store", None)
    return type(store).__name__ in ("FsspecStore", "ObjectStore", "ZipStore")


def _of_stack(path: Path, head: Head, offset: int, start: int, stop: int) -> np.ndarray:
    """Of a TIFF whose values lie one after the other, from `offset` on."""
    return np.array(np.memmap(path, head.dtype, "r", offset, head.shape)[start:stop])


@dataclass(frozen=True)
class Pages:
    """Reader of the pages of a TIFF, of which only those that are asked for are looked at."""

    path: Path
    elsewhere: bool  # in other files, which this one names

    def __call__(self, start: int, stop: int) -> np.ndarray:
        """Measurements `start` to `stop` - 1, (n, H, W)."""
        import tifffile

        with tifffile.TiffFile(self.path) as file:
            pages: Any = file.series[0].pages if self.elsewhere else file.pages
            wanted = [pages[n] for n in range(start, stop)]
            _check_there(self.path, wanted)
            return np.stack([page.asarray() for page in wanted])


def _check_there(path: Path, pages: Iterable[Any]) -> None:
    if any(page is None for page in pages):
        raise FormatError(f"{path}: some of its pictures are in other files, which are not there")


def tiff(path: Path, key: str | None) -> tuple[Head, Reader]:
    """The pages of a TIFF."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        series: Any = file.series[0]
        check_as_displayed(path, series.keyframe)
        if len(file.series) == 1 and series.dataoffset is not None and "S" not in series.axes:
            stack = tifffile.memmap(path, mode="r")
            head = Head((stack.size // int(np.prod(stack.shape[-2:])), *stack.shape[-2:]), stack.dtype)
            return head, partial(_of_stack, path, head, stack.offset)
        elsewhere = len(file.series) == 1 and any(page is None or page.parent is not file for page in series.pages)
        pages: Any = series.pages if elsewhere else file.pages
        _check_there(path, pages)
        kinds = {(page.shape, page.dtype) for page in pages}
        if len(kinds) > 1 or len(pages[0].shape) != 2:
            raise FormatError(f"{path}: grey pictures of one size were expected")
        with decoding(path):
            pages[0].asarray()
        return Head((len(pages), *pages[0].shape), pages[0].dtype), Pages(path, elsewhere)


IN_PARTS = {
    ".npy": npy,
    ".zarr": in_zarr,
    **dict.fromkeys((".h5", ".hdf5"), hdf5),
    **dict.fromkeys((".tif", ".tiff"), tiff),
}


def chosen(path: Path, arrays: Mapping[str, Head], key: str | None) -> str:
    """The name of the array that is meant."""
    names = [key] if key is not None else [name for name in NAMES if name in arrays] or list(arrays)
    if len(names) != 1 or names[0] not in arrays:
        said = ", ".join(f"{name} {head.shape}" for name, head in arrays.items()) or "none"
        raise FormatError(f"{path}: key is {key!r}, the arrays are {said}: the name of one was expected")
    return names[0]


def _head(name: str, item: Any) -> dict[str, Head]:
    """An array of numbers by its name; nothing of a group or of texts."""
    if getattr(item, "shape", None) and getattr(item.dtype, "kind", "") in "biuf":
        return {name: Head(tuple(item.shape), item.dtype)}
    return {}
