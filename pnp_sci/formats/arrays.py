"""Files as arrays: one reader and one writer per format; in memory, planes come first."""

from __future__ import annotations

import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from pnp_sci.errors import FormatError, InputError, MissingExtraError
from pnp_sci.formats import film, folder, hdf5, mat, npz, pictures, tiff, zarr

ONLY = "array"  # key of the array in formats that hold one array without a name
MAT = {".mat"}
NUMPY_LIKE = {".npy", ".npz", ".h5", ".hdf5"}
VIDEO = (".mp4", ".avi", ".mov", ".mkv", ".gif")
CONTAINERS = {".npz", ".mat", ".h5", ".hdf5"}  # formats with several named arrays
PLANES_FIRST_IN_MAT = mat.PLANES_FIRST
NO_IMAGINARY = 1e-6  # of the largest value: imaginary parts that rounding leaves, as of an inverse Fourier transform
LFS = b"version https://git-lfs"  # begins what git leaves of a file that it has not fetched

Arrays = dict[str, np.ndarray]

_log = logging.getLogger("pnp_sci")


def load(path: Path, colour: bool = False) -> Arrays:
    """All numeric arrays of a file or a folder of pictures, by name.

    With `colour` films, TIFF and folders of pictures have an axis of 3 at the end.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    FormatError
        If it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file or folder")
    if not (path.is_file() or path.is_dir()):
        raise FormatError(f"{path} is a pipe or a device: a file or a folder was expected")
    if zarr.is_store(path):
        raise FormatError(
            f"{path} is a Zarr store: pnp_sci.Result.load or pnp_sci.Reconstruction opens a result, "
            "`pnp-sci reconstruct` and pnp_sci.reconstruct read measurements"
        )
    suffix = "folder" if path.is_dir() else path.suffix.lower()
    if suffix not in _READERS:
        raise FormatError(f"{path}: cannot read {suffix or 'files without suffix'}; known are {', '.join(_READERS)}")
    if path.is_file() and _beginning(path, len(LFS)) == LFS:
        raise FormatError(f"{path} is a pointer of Git LFS, not the file itself: `git lfs pull` fetches it")
    try:
        arrays = (_READERS | _IN_COLOUR if colour else _READERS)[suffix](path)
    except (MissingExtraError, PermissionError):
        raise
    except FormatError as error:
        if str(error).startswith(str(path)):
            raise
        raise FormatError(f"{path} cannot be read: {error}") from error
    except Exception as error:  # each library has its own exceptions for a damaged file
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise FormatError(f"{path} cannot be read, it may be damaged: {reason}") from error
    arrays = {key: _real_part(key, a) for key, a in arrays.items()}
    return {key: np.ascontiguousarray(a) for key, a in arrays.items() if a.dtype.kind in "biuf" and a.size}


def _beginning(path: Path, count: int) -> bytes:
    with path.open("rb") as file:
        return file.read(count)


def _real_part(name: str, array: np.ndarray) -> np.ndarray:
    """The real part of a complex array whose imaginary part is rounding; other arrays as they are."""
    if array.dtype.kind != "c":
        return array
    real, imaginary = np.real(array), np.imag(array)
    if np.abs(imaginary).max(initial=0) > NO_IMAGINARY * np.abs(real).max(initial=0):
        _log.warning("%s is complex: real numbers were expected, and it is left out", name)
        return array
    return real


def save(path: Path, arrays: Arrays) -> None:
    """Write arrays in the format of the suffix of `path`.

    Raises
    ------
    FormatError
        If the format is unknown.
    InputError
        If there are several arrays and the format holds one.
    """
    suffix = path.suffix.lower()
    if suffix not in _WRITERS:
        raise FormatError(f"{path}: cannot write {suffix}; known are {', '.join(filter(None, _WRITERS))}, and folders")
    if suffix not in CONTAINERS and set(arrays) != {ONLY}:
        raise InputError(f"{path}: {suffix} holds a single array without name, but a mapping was given")
    _WRITERS[suffix](path, arrays)


def _only(load: Callable[..., np.ndarray], *options: bool) -> Callable[[Path], Arrays]:
    return lambda path: {ONLY: load(path, *options)}


def _save_npy(path: Path, arrays: Arrays) -> None:
    with path.open("wb") as file:  # np.save would add another suffix to a.NPY
        np.save(file, arrays[ONLY], allow_pickle=False)


_READERS: dict[str, Callable[[Path], Arrays]] = {
    ".mat": mat.load,
    ".npy": _only(npz.load_npy),
    ".npz": npz.load,
    **dict.fromkeys((".h5", ".hdf5"), hdf5.load),
    **dict.fromkeys((".tif", ".tiff"), tiff.load),
    ".png": _only(pictures.load_png),
    **dict.fromkeys(VIDEO, _only(film.load)),
    ".gif": _only(film.load_gif),
    "folder": _only(folder.load),
}
_IN_COLOUR: dict[str, Callable[[Path], Arrays]] = {
    **dict.fromkeys((".tif", ".tiff"), partial(tiff.load, colour=True)),
    ".png": _only(pictures.load_png, True),
    **dict.fromkeys(VIDEO, _only(film.load, True)),
    ".gif": _only(film.load_gif, True),
    "folder": _only(folder.load, True),
}
READABLE = tuple(suffix for suffix in _READERS if suffix != "folder")
_WRITERS: dict[str, Callable[[Path, Arrays], None]] = {
    ".mat": mat.save,
    ".npy": _save_npy,
    ".npz": npz.save,
    **dict.fromkeys((".h5", ".hdf5"), hdf5.save),
    **dict.fromkeys((".tif", ".tiff"), lambda path, arrays: tiff.save(path, arrays[ONLY])),
    ".png": lambda path, arrays: pictures.save_png(path, arrays[ONLY]),
    **dict.fromkeys(VIDEO, lambda path, arrays: film.save(path, arrays[ONLY], 10)),
    "": lambda path, arrays: folder.save(path, arrays[ONLY]),
}
