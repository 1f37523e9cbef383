"""Reading and writing of measurements, masks and videos.

In memory, planes come first: measurements (N, H, W), masks and videos (V, B, H, W). In MAT-files planes come last,
(H, W, K) or (H, W, B, V), except in the array ``pic``; in all other files they come first. A stack whose square frames
contradict this order, such as (256, 256, 8) in an NPY file, raises an error, except of :func:`read`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from pnp_sci._validate import positive_number, whole
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.formats import arrays as _formats
from pnp_sci.formats import film
from pnp_sci.formats.replacing import replacing

_NAMES = {
    "measurement": ("meas", "y", "measurement"),
    "masks": ("simu_mask", "mask", "masks"),
    "video": ("patch_save", "orig", "pic", "x", "video", "truth"),
}
_DUAL_VIEW = ("simu_mask", "patch_save")  # the benchmark of the OFaNet paper: view 1, then view 2


class Entry(NamedTuple):
    """Description of one array of a file, planes first, by :func:`describe`."""

    key: str
    shape: tuple[int, ...]
    dtype: str
    meaning: str


def read(path: str | Path, key: str | None = None) -> np.ndarray:
    """Read an array from a file, with its stored values and dtype, planes first.

    Parameters
    ----------
    path : path
        MAT (v5 and v7.3), NPY, NPZ, HDF5, TIFF (ImageJ's order), PNG, a folder of pictures in the order of their
        numbers, or a video (MP4, AVI, MOV, MKV, GIF; read as grey, all frames that are shown).
    key : str, optional
        Name of the array; needed if the file has several. A field of MATLAB's structs is ``struct.field``, an array in
        a group of HDF5 ``group/array``.

    Returns
    -------
    ndarray

    Raises
    ------
    FileNotFoundError
        If the file does not exist.
    FormatError
        If the file is damaged, or has several arrays or none; the message lists the arrays.
    """
    path = Path(path)
    arrays = _formats.load(path)
    return _chosen(path, arrays, list(arrays), key)[1]


def read_measurement(path: str | Path, key: str | None = None) -> np.ndarray:
    """Read a measurement (H, W), or several (N, H, W), from a file; path and errors as for :func:`read`.

    Parameters
    ----------
    path : path
    key : str, optional
        Name of the array. By default ``meas``, ``y`` or ``measurement``, or the only array of the file.
    """
    path = Path(path)
    name, array = _find(path, "measurement", key)
    if array.ndim not in (2, 3):
        raise FormatError(f"{path}: {name} has shape {array.shape}, (N, H, W) or (H, W) was expected of a measurement")
    return array


def read_masks(path: str | Path, views: int | None = None, key: str | None = None) -> np.ndarray:
    """Read masks (V, B, H, W), or those of each of several measurements (N, V, B, H, W), from a file; see :func:`read`.

    Parameters
    ----------
    path : path
    views : int, optional
        Number of views that the planes of a 3-D array are divided into, one view after the other. By default 2 for
        ``simu_mask``, else 1.
    key : str, optional
        Name of the array. By default ``simu_mask``, ``mask`` or ``masks``, or the only array of the file.

    Raises
    ------
    FormatError
        If the number of planes is not a multiple of `views`; other errors as for :func:`read`.
    """
    name, array = _find(Path(path), "masks", key)
    return _in_views(Path(path), name, array, views)


def read_bad(path: str | Path, key: str | None = None) -> np.ndarray:
    """Read a picture of bad pixels, those that are not 0 in it, from a file; path and errors as for :func:`read`.

    Parameters
    ----------
    path : path
    key : str, optional
        Name of the array. By default ``bad``, or the only array of the file.

    Returns
    -------
    ndarray of bool, (H, W) or (N, H, W)
        For `bad` of :func:`pnp_sci.solve`.
    """
    path = Path(path)
    arrays = _formats.load(path)
    candidates = [name for name in ("bad",) if name in arrays] or list(arrays)
    return _chosen(path, arrays, candidates, key, "picture of bad pixels")[1] != 0


def read_video(path: str | Path, views: int | None = None, key: str | None = None, colour: bool = False) -> np.ndarray:
    """Read a video (V, B, H, W), or those of several measurements (N, V, B, H, W), from a file; see :func:`read`.

    Parameters
    ----------
    path : path
    views : int, optional
        Number of views that the planes of a 3-D array are divided into, one view after the other. By default 2 for
        ``patch_save``, else 1.
    key : str, optional
        Name of the array. By default ``patch_save``, ``orig``, ``pic``, ``x``, ``video`` or ``truth``, or the only
        array of the file.
    colour : bool
        Whether it is in colour, with another axis of 3 at the end; in MAT-files (H, W, 3, B, V). In a TIFF that
        :meth:`pnp_sci.Result.export` has written, each view has three channels.

    Raises
    ------
    FormatError
        If the number of planes is not a multiple of `views`, or the video is not in colour; other errors as for
        :func:`read`.
    """
    if colour:
        return _in_colour(Path(path), views, key)
    name, array = _find(Path(path), "video", key)
    return _in_views(Path(path), name, array, views)


def describe(path: str | Path) -> list[Entry]:
    """Describe the arrays of a file: name, shape with planes first, dtype and probable meaning of each.

    Raises
    ------
    FileNotFoundError, FormatError
        As for :func:`read`.
    """
    return [
        Entry(key, array.shape, str(array.dtype), _meaning(key, array))
        for key, array in _formats.load(Path(path)).items()
    ]


def write(path: str | Path, array: Any) -> None:
    """Write an array, or a mapping of names to arrays, in the format of the path's suffix.

    :func:`read` returns it with the same dtype and shape, except from formats for display. These are MP4, AVI, GIF, PNG
    and folders of PNGs (a path without suffix), which have 8 bits: floats are clipped to [0, 1] and scaled to 0..255.
    PNG also stores uint16. Writing is atomic: after an error, an earlier file at this path is unchanged.

    Parameters
    ----------
    path : path
    array : array_like or mapping of str to array_like
        Real numbers, one at least, on one axis at least. A mapping needs NPZ, HDF5 or MAT; in the first two it may
        hold single numbers, which are read as arrays of one value.

    Raises
    ------
    InputError, InputTypeError, FormatError
        If an array is empty or cannot be stored in this format, or the suffix is unknown.
    FileNotFoundError
        If the folder does not exist.

    Examples
    --------
    >>> import numpy as np, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write(folder + "/scene.npz", {"y": np.ones((4, 5)), "masks": np.ones((2, 3, 4, 5), bool)})
    ...     read_masks(folder + "/scene.npz").shape
    (2, 3, 4, 5)
    """
    named = array if isinstance(array, Mapping) else {_formats.ONLY: array}
    arrays = {str(key): np.asarray(a) for key, a in named.items()}
    for key, a in arrays.items():
        if a.dtype.kind not in "biuf":
            raise InputTypeError(f"{key} has dtype {a.dtype}: real numbers were expected")
        if a.size == 0 or (a.ndim == 0 and array is not named):
            raise InputError(f"{key} has shape {a.shape}: an array with axes, none of them of length 0, was expected")
    if not arrays:
        raise InputError("array is a mapping without arrays: one at least was expected")
    with replacing(Path(path)) as temporary:
        _formats.save(temporary, arrays)


def write_video(path: str | Path, frames: Any, fps: float = 10) -> None:
    """Write frames as MP4, AVI or GIF, for display.

    Parameters
    ----------
    path : path
    frames : array_like, (B, H, W), or in colour (B, H, W, 3)
        Floats are clipped to [0, 1] and scaled to 0..255; bool becomes 0 and 255; uint8 is unchanged.
    fps : float
        Frames per second, > 0.

    Raises
    ------
    InputError, InputTypeError, FormatError
        If `frames`, `fps` or the suffix of `path` cannot be used.
    """
    path = Path(path)
    if path.suffix.lower() not in _formats.VIDEO:
        raise FormatError(f"{path}: cannot write a video as {path.suffix}; known are {', '.join(_formats.VIDEO)}")
    positive_number("fps", fps)
    with replacing(path) as temporary:
        film.save(temporary, np.asarray(frames), fps)


def _find(path: Path, kind: str, key: str | None, colour: bool = False) -> tuple[str, np.ndarray]:
    """Name and array of this kind in a file; raises a FormatError if its planes may not come first."""
    arrays = _formats.load(path, colour)
    others = {name for names in _NAMES.values() for name in names} - set(_NAMES[kind])
    candidates = [name for name in _NAMES[kind] if name in arrays] or [n for n in arrays if _field(n) in _NAMES[kind]]
    if not candidates and len(arrays) == 1:
        candidates = [name for name in arrays if _field(name) not in others]
    name, array = _chosen(path, arrays, candidates, key, kind)
    colours = (-3 if path.suffix.lower() in _formats.MAT else -1,) if colour else ()
    if _doubtful(path, name, tuple(np.delete(array.shape, colours).tolist())):
        raise FormatError(
            f"{path}: {name} has shape {array.shape} with planes first, but its square frames indicate another order "
            "of axes: write it again with planes last in a MAT-file, or first in any other. If planes do come first, "
            "pnp_sci.io.read reads it, and a TIFF is not refused"
        )
    return name, array


def _chosen(
    path: Path, arrays: Mapping[str, np.ndarray], candidates: list[str], key: str | None, kind: str = "array"
) -> tuple[str, np.ndarray]:
    there = ", ".join(f"{name} {array.shape}" for name, array in arrays.items()) or "no numeric array"
    if key is not None:
        spellings = [key, key.replace("/", "."), key.replace(".", "/")] if isinstance(key, str) else []
        name = next((name for name in spellings if name in arrays), None)
        if name is None:
            raise FormatError(f"{path}: key {key!r} is not in the file, which holds {there}")
        return name, arrays[name]
    if len(candidates) != 1:
        problem = f"{' and '.join(candidates)} could each be the {kind}" if candidates else f"no {kind} was recognised"
        raise FormatError(f"{path}: {problem}; the file holds {there}: name the {kind} by key=")
    return candidates[0], arrays[candidates[0]]


def _field(name: str) -> str:
    """The last part of ``struct.field`` and ``group/array``."""
    return name.replace("/", ".").rpartition(".")[2]


def _doubtful(path: Path, name: str, shape: tuple[int, ...]) -> bool:
    """Whether two equal axes that are much larger than the others are not rows and columns."""
    in_mat = path.suffix.lower() in _formats.MAT and name not in _formats.PLANES_FIRST_IN_MAT
    if not in_mat and path.suffix.lower() not in _formats.NUMPY_LIKE:
        return False
    if len(shape) == 4:
        return shape[0] == shape[1] > max(shape[2:])
    if len(shape) != 3:
        return False
    planes, rows, columns = shape
    return planes == columns >= 2 * rows if in_mat else planes == rows >= 2 * columns


def _in_views(path: Path, name: str, array: np.ndarray, views: int | None) -> np.ndarray:
    """Reshape planes (V * B, H, W) to (V, B, H, W); an array with as many views, of N measurements too, stays."""
    views = None if views is None else whole("views", views, 1)
    if array.ndim in (4, 5) and views in (None, array.shape[-4]):
        return array
    planes = array[None] if array.ndim == 2 else array
    views = views or (2 if name in _DUAL_VIEW else 1)
    if planes.ndim != 3 or len(planes) % views:
        raise FormatError(
            f"{path}: {name} has shape {array.shape} with planes first: (V, B, H, W), or planes for {views} views, "
            "was expected"
        )
    return planes.reshape(views, -1, *planes.shape[1:])


def _in_colour(path: Path, views: int | None, key: str | None) -> np.ndarray:
    """A colour video (V, B, H, W, 3), or those of several measurements."""
    _, array = _find(path, "video", key, True)
    if path.suffix.lower() in _formats.MAT and array.ndim > 3:
        array = np.moveaxis(array, -3, -1)
    views = None if views is None else whole("views", views, 1)
    if array.ndim not in (4, 5, 6) or array.shape[-1] != 3 or (array.ndim == 4 and len(array) % (views or 1)):
        expected = f"(views, frames, rows, columns, 3), or frames for {views or 1} views, was expected"
        raise FormatError(f"{path}: the video has shape {array.shape}: in colour, {expected}")
    if array.ndim == 4 or (array.ndim == 5 and len(array) == 1 and views):
        return array.reshape(views or 1, -1, *array.shape[-3:])
    return array


def _meaning(key: str, array: np.ndarray) -> str:
    kind = next((kind for kind, names in _NAMES.items() if _field(key) in names), None)
    if array.ndim not in (2, 3, 4, 5) or min(array.shape[-2:]) < 2:
        return "not a picture"
    size = f"{array.shape[-2]} x {array.shape[-1]}"
    if array.ndim == 5 and array.shape[-1] == 3:
        views, frames, rows, columns, _ = array.shape
        return f"{kind or 'frames'}: {views} views x {frames} frames of {rows} x {columns} in colour"
    if array.ndim == 5:
        return f"{kind or 'frames'} of {len(array)} measurements, each {array.shape[1]} x {array.shape[2]} of {size}"
    if array.ndim == 4:
        return f"{kind or 'frames'}: {array.shape[0]} views x {array.shape[1]} frames of {size}"
    if array.ndim == 2:
        return f"{kind or 'a measurement or a picture'}: {size}"
    if kind == "measurement":
        return f"{len(array)} measurements of {size}"
    if _field(key) in _DUAL_VIEW:
        return f"{kind}: 2 views x {len(array) // 2} frames of {size}"
    return f"{kind or 'measurements, masks or frames'}: {len(array)} planes of {size}"
