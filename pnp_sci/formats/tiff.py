"""TIFF: stacks, also ImageJ's and OME's, whose channels are views and whose times and slices are frames."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.channels import are_colours, are_views, in_colour
from pnp_sci.formats.pictures import of_samples

CODECS = "imagecodecs"  # the package that tifffile asks for where a compression is not its own
MIN_IS_WHITE, PALETTE = 0, 3  # PhotometricInterpretation (TIFF 6.0)


def load(path: Path, colour: bool = False) -> dict[str, np.ndarray]:
    """The stack of a TIFF, or its series by name, in colour with an axis of 3 at the end; equal pages are one stack."""
    import tifffile

    with tifffile.TiffFile(path) as file:
        _check_pages(path, file)
        if any(page is None for series in file.series for page in series.pages):
            raise FormatError(f"{path}: some of its pictures are in other files, which are not there")
        if file.is_imagej:
            return {"array": _from_imagej(path, file, colour)}
        arrays, names = [], _channels_of_ome(file)
        for series in file.series:
            array, axes = _samples_last(path, _values(path, series), series.axes, colour)
            array = _views_first(array, axes, are_views(names)) if file.is_ome else array
            arrays.append(_of_channels(path, array, names, colour))
    if len(arrays) > 1 and arrays[0].ndim == 2 + colour and len({(a.shape, a.dtype) for a in arrays}) == 1:
        return {"array": np.stack(arrays)}
    return {"array": arrays[0]} if len(arrays) == 1 else {f"series{i}": a for i, a in enumerate(arrays)}


def _values(path: Path, series: Any) -> np.ndarray:
    """The values of a series as they are displayed: white is the largest."""
    inverted = series.keyframe.photometric == MIN_IS_WHITE
    try:
        array = series.asarray()
    except Exception as error:  # ValueError or NotImplementedError
        if CODECS not in str(error):
            raise
        array = _by_pillow(path, series, str(error))
        inverted = inverted and array.dtype.itemsize > 1  # Pillow has inverted 8 bits and less
    if series.keyframe.photometric == PALETTE:
        red, green, blue = series.keyframe.colormap >> 8
        if (red != green).any() or (red != blue).any():
            raise FormatError(f"{path}: a palette of colours came, grey values were expected")
        return red[array].astype(np.uint8)
    if inverted and array.dtype.kind in "bu":
        return ~array if array.dtype == bool else 2**series.keyframe.bitspersample - 1 - array
    return array


def _by_pillow(path: Path, series: Any, reason: str) -> np.ndarray:
    """The same by Pillow, which knows more kinds of compression, page by page."""
    from PIL import Image

    pages, files = [], {}
    try:
        for page in series.pages:
            place = page.parent.filehandle.path
            if place not in files:
                files[place] = Image.open(place)
            files[place].seek(page.index)
            pages.append(np.array(files[place]))
        return np.stack(pages).reshape(series.shape)
    except (OSError, SyntaxError, TypeError, ValueError) as error:
        raise _needs_codecs(path, reason) from error
    finally:
        for file in files.values():
            file.close()


def _needs_codecs(path: Path, reason: str) -> FormatError:
    return FormatError(f"{path} needs the package {CODECS} (python -m pip install {CODECS}): {reason}")


def check_as_displayed(path: Path, page: Any) -> None:
    """Raise a FormatError if the values of a page are not those that are displayed."""
    if page.photometric in (MIN_IS_WHITE, PALETTE):
        raise FormatError(
            f"{path}: its values are not as displayed (palette, or 0 is white): write it anew as plain grey"
        )


@contextmanager
def decoding(path: Path) -> Iterator[None]:
    """Context in which a compression that tifffile does not know is a FormatError."""
    try:
        yield
    except Exception as error:  # ValueError or NotImplementedError
        if CODECS not in str(error):
            raise
        raise _needs_codecs(path, str(error)) from error


def _samples_last(path: Path, array: np.ndarray, axes: str, colour: bool) -> tuple[np.ndarray, str]:
    """Grey values, or colours on the last axis, and the other axes."""
    if "S" not in axes:
        return array, axes
    return of_samples(path, np.moveaxis(array, axes.index("S"), -1), colour), axes.replace("S", "")


def _channels_of_ome(file: Any) -> list[str]:
    """The names of the channels in OME-XML."""
    return re.findall(r'<(?:\w+:)?Channel\b[^>]*\bName="([^"]*)"', file.ome_metadata or "")


def _of_channels(path: Path, array: np.ndarray, names: list[str], colour: bool) -> np.ndarray:
    """Grey values, or colours on the last axis, of channels (3 V, B, H, W) with the names of colours."""
    if array.ndim != 4 or len(array) != len(names) or not are_colours(names):
        return array
    return of_samples(path, in_colour(array), colour)


def _views_first(array: np.ndarray, axes: str, named: bool) -> np.ndarray:
    """Axes of OME such as TCYX or ZCYX as (views, frames, rows, columns); others as they are.

    So is a stack with channels only, which may be one of planes, unless the channels are `named` as views.
    """
    if (len(axes) < 4 and not named) or "C" not in axes or not set(axes) <= set("TZCYX"):
        return array
    array = np.moveaxis(array, axes.index("C"), 0)
    return array.reshape(len(array), -1, *array.shape[axes.index("Y") :])


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


def _from_imagej(path: Path, file: Any, colour: bool) -> np.ndarray:
    """ImageJ's (T, Z, C, Y, X) as (views, frames, rows, columns), with the number of dimensions that was written.

    A stack with channels only is one of planes: tifffile writes stacks without named axes this way.
    """
    series = file.series[0]
    stack = _values(path, series).reshape(series.get_shape(squeeze=False))
    stack = of_samples(path, stack, colour) if stack.shape[-1] > 1 else stack[..., 0]
    times, slices, channels, *size = stack.shape
    stack = np.moveaxis(stack, 2, 0).reshape(channels, times * slices, *size)
    written = (file.imagej_metadata or {}).get("ndim")
    if written is None and channels > 1 and times * slices == 1:
        return stack[:, 0]
    ndim = int(written or (4 if channels > 1 else 3 if times * slices > 1 else 2))
    labels = (file.imagej_metadata or {}).get("Labels", [])
    return _of_channels(path, stack.reshape(stack.shape[4 - ndim :]), labels[:channels], colour)


def save(path: Path, array: np.ndarray) -> None:
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
