"""Files as arrays: one reader and one writer per format; in memory, planes come first.

In MAT-files planes come last, (H, W, K) and (H, W, B, V); readers and writers transpose them.
"""

from __future__ import annotations

import math
import re
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError, InputTypeError, MissingExtraError
from pnp_sci.formats import mat_check as _mat

ONLY = "array"  # key of the array in formats that hold one array without a name
MAT = {".mat"}
NUMPY_LIKE = {".npy", ".npz", ".h5", ".hdf5"}
VIDEO = {".mp4", ".avi", ".mov", ".mkv", ".gif"}
CONTAINERS = {".npz", ".mat", ".h5", ".hdf5"}  # formats with several named arrays
HDF5_SIGNATURE = b"\x89HDF\r\n\x1a\n"
PLANES_FIRST_IN_MAT = {"pic"}  # names of arrays with planes first in MAT-files, as in BIRNAT's published results

Arrays = dict[str, np.ndarray]


def load(path: Path) -> Arrays:
    """All numeric arrays of a file or a folder of PNGs, by name.

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
    try:
        arrays = _READERS[suffix](path)
    except (FormatError, MissingExtraError, PermissionError):
        raise
    except Exception as error:  # each library has its own exceptions for a damaged file
        reason = (str(error) or type(error).__name__).splitlines()[0]
        raise FormatError(f"{path} cannot be read, it may be damaged: {reason}") from error
    # h5py returns names that are not UTF-8 as bytes
    return {str(key): np.ascontiguousarray(a) for key, a in arrays.items() if a.dtype.kind in "biuf" and a.size}


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


def eight_bit(frames: np.ndarray) -> np.ndarray:
    """Frames as uint8: floats are clipped to [0, 1] and scaled to 0..255, bool becomes 0 and 255."""
    if frames.dtype == np.uint8:
        return frames
    if frames.dtype != bool and frames.dtype.kind != "f":
        raise InputTypeError(f"frames have dtype {frames.dtype}: floats in [0, 1], bool or uint8 were expected")
    return np.round(np.clip(np.nan_to_num(frames.astype(np.float32)), 0, 1) * 255).astype(np.uint8)


def save_video(path: Path, frames: np.ndarray, fps: float) -> None:
    """Write frames (B, H, W) as MP4 (H.264), AVI (uncompressed grey) or GIF; AVI and GIF are exact for 8 bits."""
    with needed_for("writing a video", "video"):
        import imageio_ffmpeg

    if frames.ndim != 3 or frames.size == 0:
        raise InputError(f"frames has shape {frames.shape}: (frames, rows, columns) was expected")
    frames = np.ascontiguousarray(eight_bit(frames))
    even = frames.shape[1] % 2 == 0 and frames.shape[2] % 2 == 0
    h264 = ("libx264", "yuv420p" if even else "yuv444p", ["-crf", "12"])
    codec, pixels, options = {".avi": ("rawvideo", "gray", []), ".gif": ("gif", "gray", [])}.get(
        path.suffix.lower(), h264
    )
    writer = imageio_ffmpeg.write_frames(
        str(path),
        (frames.shape[2], frames.shape[1]),
        pix_fmt_in="gray",
        pix_fmt_out=pixels,
        fps=fps,  # type: ignore[arg-type]
        codec=codec,
        quality=None,  # type: ignore[arg-type]
        macro_block_size=1,
        output_params=options,
        ffmpeg_log_level="fatal",
    )
    writer.send(None)
    try:
        for frame in frames:
            writer.send(frame)
    finally:
        writer.close()
    if not path.is_file() or path.stat().st_size == 0:
        raise OSError(f"{path}: ffmpeg could not write {frames.shape[2]} x {frames.shape[1]} pixels as {codec}")


def _load_mat(path: Path) -> Arrays:
    import scipy.io

    if _is_hdf5(path):  # v7.3, seen by h5py with its axes reversed
        h5py = _h5py()
        with h5py.File(path) as file:
            sets = {key: item for key, item in file.items() if isinstance(item, h5py.Dataset)}
            arrays = {
                key: item[()].astype(bool) if item.attrs.get("MATLAB_class") == b"logical" else item[()]
                for key, item in sets.items()
            }
        return {key: np.asarray(a).swapaxes(-1, -2) if np.ndim(a) > 1 else np.asarray(a) for key, a in arrays.items()}
    _mat.check(path.read_bytes())
    logical = {key for key, _, kind in scipy.io.whosmat(path) if kind == "logical"}
    arrays = {key: a for key, a in scipy.io.loadmat(path).items() if isinstance(a, np.ndarray)}
    arrays = {key: a.astype(bool) if key in logical else a for key, a in arrays.items()}
    return {key: a if key in PLANES_FIRST_IN_MAT else _planes_first(a) for key, a in arrays.items()}


def _planes_first(array: np.ndarray) -> np.ndarray:
    """Transpose (H, W, K) to (K, H, W), or (H, W, B, V) to (V, B, H, W)."""
    return array.transpose(*range(array.ndim - 1, 1, -1), 0, 1) if array.ndim > 2 else array


def _save_mat(path: Path, arrays: Arrays) -> None:
    import scipy.io

    for key, a in arrays.items():
        if a.ndim < 2 or a.dtype in (np.float16, np.longdouble):
            raise InputTypeError(f"{key} is {a.dtype} {a.shape}: MAT-files have no 1-D, float16 or longdouble arrays")
    last = {key: a.transpose(-2, -1, *range(a.ndim - 3, -1, -1)) for key, a in arrays.items()}
    scipy.io.savemat(path, last, do_compression=True)


def _is_hdf5(path: Path) -> bool:
    """Whether a file has HDF5's signature, at its beginning or after a header of 512, 1024 or 2048 bytes."""
    with path.open("rb") as file:
        start = file.read(2048 + len(HDF5_SIGNATURE))
    return any(start.startswith(HDF5_SIGNATURE, offset) for offset in (0, 512, 1024, 2048))


def _h5py() -> Any:
    with needed_for("HDF5, which is also the format of MAT-files v7.3,", "hdf5"):
        import h5py
    return h5py


def _load_npy(path: Path) -> Arrays:
    with path.open("rb") as file:
        return {ONLY: np.lib.format.read_array(file, allow_pickle=False)}


def _load_npz(path: Path) -> Arrays:
    if not zipfile.is_zipfile(path):
        raise FormatError(f"{path} is not an NPZ archive, or it is truncated")
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        return {key: file[key] for key in file}


def _load_h5(path: Path) -> Arrays:
    h5py = _h5py()
    arrays: Arrays = {}
    with h5py.File(path) as file:
        file.visititems(
            lambda key, item: arrays.update({key: np.asarray(item[()])}) if isinstance(item, h5py.Dataset) else None
        )
    return arrays


def _save_h5(path: Path, arrays: Arrays) -> None:
    h5py = _h5py()
    with h5py.File(path, "w") as file:
        for key, a in arrays.items():
            file.create_dataset(key, data=a, compression="gzip" if a.size > 1 else None)


def _load_tiff(path: Path) -> Arrays:
    import tifffile

    with tifffile.TiffFile(path) as file:
        _check_pages(path, file)
        if any(series.axes.endswith("S") for series in file.series):
            raise FormatError(f"{path}: colour pictures came, grey ones were expected")
        if file.is_imagej:
            return {ONLY: _from_imagej(file)}
        arrays = [series.asarray() for series in file.series]
    if len(arrays) > 1 and arrays[0].ndim == 2 and len({(a.shape, a.dtype) for a in arrays}) == 1:
        return {ONLY: np.stack(arrays)}  # pages of equal size are one stack
    return {ONLY: arrays[0]} if len(arrays) == 1 else {f"series{i}": a for i, a in enumerate(arrays)}


def _check_pages(path: Path, file: Any) -> None:
    """Raise a FormatError for damaged pages, of which tifffile only logs a warning.

    It must come first, because tifffile does not terminate on a cycle of pages.
    """
    file.filehandle.seek(file.pages.next_page_offset)
    if any(file.filehandle.read(file.tiff.offsetsize)):
        raise FormatError(f"{path}: the last page points to another one")
    for page in file.pages:
        if len(page.dataoffsets) != math.prod(page.keyframe.chunked):
            raise FormatError(f"{path}: a page has {len(page.dataoffsets)} parts, not {page.keyframe.chunked}")


def _from_imagej(file: object) -> np.ndarray:
    """ImageJ's (T, Z, C, Y, X) as (views, frames, rows, columns), with the number of dimensions that was written.

    A stack with channels only is one of planes: tifffile writes stacks without named axes this way.
    """
    stack = file.series[0].asarray(squeeze=False)[..., 0]  # type: ignore[attr-defined]
    times, slices, channels, rows, columns = stack.shape
    stack = np.moveaxis(stack, 2, 0).reshape(channels, times * slices, rows, columns)
    written = (file.imagej_metadata or {}).get("ndim")  # type: ignore[attr-defined]
    if written is None and channels > 1 and times * slices == 1:
        return stack[:, 0]
    ndim = int(written or (4 if channels > 1 else 3 if times * slices > 1 else 2))
    return stack.reshape(stack.shape[4 - ndim :])


def _save_tiff(path: Path, arrays: Arrays) -> None:
    import tifffile

    array = arrays[ONLY]
    for_imagej = array.dtype in (np.uint8, np.uint16, np.float32) and array.ndim in (2, 3, 4)
    if for_imagej and array.shape[-1] > 1:  # tifffile would read a single column as colour samples
        stack = array.swapaxes(0, 1) if array.ndim == 4 else array
        axes = {2: "YX", 3: "TYX", 4: "TCYX"}[array.ndim]
        tifffile.imwrite(path, stack, imagej=True, metadata={"axes": axes, "ndim": array.ndim})
    else:
        tifffile.imwrite(path, array, photometric="minisblack")


def _load_png(path: Path) -> Arrays:
    import imageio.v3

    picture = imageio.v3.imread(path, plugin="pillow")
    if picture.ndim == 3:
        if picture.shape[2] > 2 and (picture[..., :1] != picture[..., 1:3]).any():
            raise FormatError(f"{path}: a colour picture came, a grey one was expected")
        picture = picture[..., 0]
    return {ONLY: picture}


def _save_png(path: Path, arrays: Arrays) -> None:
    import imageio.v3

    picture = arrays[ONLY]
    if picture.ndim != 2:
        raise InputError(
            f"{path}: a PNG holds (rows, columns), but {picture.shape} came; a path without suffix makes a folder"
        )
    picture = picture if picture.dtype == np.uint16 else eight_bit(picture)
    imageio.v3.imwrite(path, picture, plugin="pillow", extension=".png")


def _load_folder(path: Path) -> Arrays:
    files = sorted(
        path.glob("*.png"), key=lambda file: [int(p) if p.isdigit() else p for p in re.split(r"(\d+)", file.name)]
    )
    if not files:
        raise FormatError(f"{path}: the folder has no PNG files")
    frames = [_load_png(file)[ONLY] for file in files]
    if len({frame.shape for frame in frames}) > 1:
        raise FormatError(f"{path}: the pictures have different sizes {sorted({frame.shape for frame in frames})}")
    return {ONLY: np.stack(frames)}


def _save_folder(path: Path, arrays: Arrays) -> None:
    if arrays[ONLY].ndim != 3:
        raise InputError(f"{path}: a folder of PNGs holds (frames, rows, columns), but {arrays[ONLY].shape} came")
    path.mkdir()
    for i, frame in enumerate(arrays[ONLY]):
        _save_png(path / f"frame_{i:04d}.png", {ONLY: frame})


def _load_video(path: Path) -> Arrays:
    with needed_for("reading a video", "video"):
        import imageio_ffmpeg

    reader = imageio_ffmpeg.read_frames(str(path), pix_fmt="gray", bits_per_pixel=8)
    with closing(reader):
        meta = next(reader)
        columns, rows = meta["size"]
        frames = [np.frombuffer(frame, np.uint8).reshape(rows, columns) for frame in reader]
    expected = meta["duration"] * meta["fps"]
    tolerance = 0.8 + 0.006 * meta["fps"]  # the duration is rounded to 0.01 s; a missing frame is an error
    if meta.get("audio_codec"):
        tolerance += 0.1 * expected  # the sound may be longer than the video
    if len(frames) < expected - tolerance:
        raise FormatError(f"{path}: {len(frames)} of {expected:.0f} frames can be read, the file seems truncated")
    return {ONLY: np.stack(frames)}


def _load_gif(path: Path) -> Arrays:
    import imageio.v3

    return {ONLY: imageio.v3.imread(path, plugin="pillow", mode="L")}


_READERS: dict[str, Callable[[Path], Arrays]] = {
    ".mat": _load_mat,
    ".npy": _load_npy,
    ".npz": _load_npz,
    **dict.fromkeys((".h5", ".hdf5"), _load_h5),
    **dict.fromkeys((".tif", ".tiff"), _load_tiff),
    ".png": _load_png,
    **dict.fromkeys(VIDEO, _load_video),
    ".gif": _load_gif,
    "folder": _load_folder,
}
_WRITERS: dict[str, Callable[[Path, Arrays], None]] = {
    ".mat": _save_mat,
    ".npy": lambda path, arrays: np.save(path, arrays[ONLY], allow_pickle=False),
    ".npz": lambda path, arrays: np.savez_compressed(path, allow_pickle=False, **arrays),
    **dict.fromkeys((".h5", ".hdf5"), _save_h5),
    **dict.fromkeys((".tif", ".tiff"), _save_tiff),
    ".png": _save_png,
    **dict.fromkeys(VIDEO, lambda path, arrays: save_video(path, arrays[ONLY], 10)),
    "": _save_folder,
}
