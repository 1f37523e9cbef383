"""Files as arrays: one reader and one writer per format; in memory, planes come first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from pnp_sci.errors import FormatError, InputError, MissingExtraError
from pnp_sci.formats import film, hdf5, mat, npz, pictures

ONLY = "array"  # key of the array in formats that hold one array without a name
MAT = {".mat"}
NUMPY_LIKE = {".npy", ".npz", ".h5", ".hdf5"}
VIDEO = {".mp4", ".avi", ".mov", ".mkv", ".gif"}
CONTAINERS = {".npz", ".mat", ".h5", ".hdf5"}  # formats with several named arrays
PLANES_FIRST_IN_MAT = mat.PLANES_FIRST
LFS = b"version https://git-lfs"  # begins what git leaves of a file that it has not fetched

Arrays = dict[str, np.ndarray]


def load(path: Path) -> Arrays:
    """All numeric arrays of a file or a folder of pictures, by name.

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    FormatError
        If it cannot be read.
    """
    if not path.exists():
        raise FileNotFoundError(f"{path}: there is no such file or folder")
    suffix = "folder" if path.is_dir() else path.suffix.lower()
    if suffix not in _READERS:
        raise FormatError(f"{path}: cannot read {suffix or 'files without suffix'}; known are {', '.join(_READERS)}")
    if path.is_file() and path.open("rb").read(len(LFS)) == LFS:
        raise FormatError(f"{path} is a pointer of Git LFS, not the file itself: `git lfs pull` fetches it")
    try:
        arrays = _READERS[suffix](path)
    except (MissingExtraError, PermissionError):
        raise
    except FormatError as error:
        if str(error).startswith(str(path)):
            raise
        raise FormatError(f"{path} cannot be read: {error}") from error
    except Exception as error:  # each library has its own exceptions for a damaged file
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise FormatError(f"{path} cannot be read, it may be damaged: {reason}") from error
    return {key: np.ascontiguousarray(a) for key, a in arrays.items() if a.dtype.kind in "biuf" and a.size}


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


def _only(load: Callable[[Path], np.ndarray]) -> Callable[[Path], Arrays]:
    return lambda path: {ONLY: load(path)}


_READERS: dict[str, Callable[[Path], Arrays]] = {
    ".mat": mat.load,
    ".npy": _only(npz.load_npy),
    ".npz": npz.load,
    **dict.fromkeys((".h5", ".hdf5"), hdf5.load),
    **dict.fromkeys((".tif", ".tiff"), pictures.load_tiff),
    ".png": _only(pictures.load_png),
    **dict.fromkeys(VIDEO, _only(film.load)),
    ".gif": _only(film.load_gif),
    "folder": _only(pictures.load_folder),
}
READABLE = tuple(suffix for suffix in _READERS if suffix != "folder")
_WRITERS: dict[str, Callable[[Path, Arrays], None]] = {
    ".mat": mat.save,
    ".npy": lambda path, arrays: np.save(path, arrays[ONLY], allow_pickle=False),
    ".npz": npz.save,
    **dict.fromkeys((".h5", ".hdf5"), hdf5.save),
    **dict.fromkeys((".tif", ".tiff"), lambda path, arrays: pictures.save_tiff(path, arrays[ONLY])),
    ".png": lambda path, arrays: pictures.save_png(path, arrays[ONLY]),
    **dict.fromkeys(VIDEO, lambda path, arrays: film.save(path, arrays[ONLY], 10)),
    "": lambda path, arrays: pictures.save_folder(path, arrays[ONLY]),
}
