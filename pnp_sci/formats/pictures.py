"""Pictures: PNG, TIFF, and folders of them. In memory, planes come first."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, InputError, InputTypeError

FRAMES = {".png", ".tif", ".tiff"}  # what a folder may hold
TRUE_COLOUR, GREY_ALPHA, TRUE_COLOUR_ALPHA = 2, 4, 6  # colour types of PNG (ISO 15948)


def eight_bit(frames: np.ndarray) -> np.ndarray:
    """Frames as uint8: floats are clipped to [0, 1] and scaled to 0..255, bool becomes 0 and 255."""
    if frames.dtype == np.uint8:
        return frames
    if frames.dtype != bool and frames.dtype.kind != "f":
        raise InputTypeError(f"frames have dtype {frames.dtype}: floats in [0, 1], bool or uint8 were expected")
    return np.round(np.clip(np.nan_to_num(frames.astype(np.float32)), 0, 1) * 255).astype(np.uint8)


def load_png(path: Path) -> np.ndarray:
    """A grey picture (H, W) of 8 or 16 bits; colours must be grey, and transparency is dropped."""
    picture = _open_png(path)
    if picture.ndim == 3:
        if picture.shape[2] > 2 and (picture[..., :1] != picture[..., 1:3]).any():
            raise FormatError(f"{path}: a colour picture came, a grey one was expected")
        picture = picture[..., 0]
    return picture


def _open_png(path: Path) -> np.ndarray:
    content = path.read_bytes()
    bits, kind = content[24], content[25]  # of the header
    if bits == 16 and kind in (TRUE_COLOUR, GREY_ALPHA, TRUE_COLOUR_ALPHA):  # Pillow would keep 8 bits
        import cv2

        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise FormatError(f"{path} cannot be read, it may be damaged")
        return picture
    import imageio.v3

    return imageio.v3.imread(content, plugin="pillow", extension=".png")


def save_png(path: Path, picture: np.ndarray, colour: bool = False) -> None:
    """Write a picture (H, W): uint16 as it is, others as 8 bits; in colour (H, W, 3), of 8 bits."""
    import imageio.v3

    if picture.ndim != 2 + colour:
        raise InputError(
            f"{path}: a PNG holds (rows, columns), but {picture.shape} came; a path without suffix makes a folder"
        )
    picture = picture if picture.dtype == np.uint16 and not colour else eight_bit(picture)
    imageio.v3.imwrite(path, picture, plugin="pillow", extension=".png")


def load_folder(path: Path) -> np.ndarray:
    """The pictures (B, H, W) of a folder in the order of the numbers in their names; hidden files are left out."""
    files = [f for f in path.iterdir() if f.suffix.lower() in FRAMES and f.name[0] != "." and f.is_file()]
    if not files:
        raise FormatError(f"{path}: the folder has no pictures; known are {', '.join(sorted(FRAMES))}")
    files.sort(key=numbered)
    frames = [load_png(f) if f.suffix.lower() == ".png" else _only_page(f) for f in files]
    kinds = {(frame.shape, str(frame.dtype)) for frame in frames}
    if len(kinds) > 1:
        raise FormatError(f"{path}: the pictures have different sizes or types: {sorted(kinds)}")
    return np.stack(frames)


def numbered(file: Path) -> list[Any]:
    """Sort key: numbers in names count as numbers."""
    return [int(part) if n % 2 else part for n, part in enumerate(re.split(r"([0-9]+)", file.name))]


def _only_page(path: Path) -> np.ndarray:
    arrays = load_tiff(path)
    if len(arrays) > 1 or (page := next(iter(arrays.values()))).ndim != 2:
        raise FormatError(f"{path} holds several pictures: one of each file of a folder was expected")
    return page


def save_folder(path: Path, frames: np.ndarray) -> None:
    """Write frames (B, H, W) as PNGs."""
    if frames.ndim != 3:
        raise InputError(f"{path}: a folder of PNGs holds (frames, rows, columns), but {frames.shape} came")
    path.mkdir()
    for i, frame in enumerate(frames):
        save_png(path / f"frame_{i:04d}.png", frame)


def load_tiff(path: Path) -> dict[str, np.ndarray]:
    """The stack of a TIFF, or its series by name; pages of equal size are one stack."""
    try:
        return _by_tifffile(path)
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
    from PIL import Image, ImageSequence

    with Image.open(path) as file:  # knows more kinds of compression
        pages = [np.array(page) for page in ImageSequence.Iterator(file)]
    if pages[0].ndim != 2:
        raise FormatError(f"{path}: colour pictures came, grey ones were expected")
    return {"array": np.stack(pages) if len(pages) > 1 else pages[0]}


def _by_tifffile(path: Path) -> dict[str, np.ndarray]:
    import tifffile

    with tifffile.TiffFile(path) as file:
        _check_pages(path, file)
        if any(series.axes.endswith("S") for series in file.series):
            raise FormatError(f"{path}: colour pictures came, grey ones were expected")
        if file.is_imagej:
            return {"array": _from_imagej(file)}
        if any(page is None for series in file.series for page in series.pages):
            raise FormatError(f"{path}: some of its pictures are in other files, which are not there")
        if file.is_ome and len(file.series) == 1 and file.series[0].axes == "TCYX":
            return {"array": file.series[0].asarray().swapaxes(0, 1)}
        arrays = [series.asarray() for series in file.series]
    if len(arrays) > 1 and arrays[0].ndim == 2 and len({(a.shape, a.dtype) for a in arrays}) == 1:
        return {"array": np.stack(arrays)}  # pages of equal size are one stack
    return {"array": arrays[0]} if len(arrays) == 1 else {f"series{i}": a for i, a in enumerate(arrays)}


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


def save_tiff(path: Path, array: np.ndarray) -> None:
    """Write (H, W), (B, H, W) or (V, B, H, W), for ImageJ where it knows the type."""
    import tifffile

    if array.ndim < 2 or array.dtype == np.longdouble:
        raise InputError(f"{path}: TIFF holds pictures of up to 64 bits, but {array.dtype} {array.shape} came")
    for_imagej = array.dtype in (np.uint8, np.uint16, np.float32) and array.ndim in (2, 3, 4)
    if for_imagej and array.shape[-1] > 1:  # tifffile would read a single column as colour samples
        stack = array.swapaxes(0, 1) if array.ndim == 4 else array
        axes = {2: "YX", 3: "TYX", 4: "TCYX"}[array.ndim]
        tifffile.imwrite(path, stack, imagej=True, metadata={"axes": axes, "ndim": array.ndim})
    else:
        tifffile.imwrite(path, array, photometric="minisblack")
