"""Folders of pictures, one a frame."""

from __future__ import annotations

import logging
import re
from pathlib import Path

import numpy as np

from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.pictures import load_png, numbered, save_png
from pnp_sci.formats.plain import some
from pnp_sci.formats.tiff import load as load_tiff

KNOWN = {".png", ".tif", ".tiff"}

_log = logging.getLogger("pnp_sci")


def load(path: Path, colour: bool = False) -> np.ndarray:
    """The pictures (B, H, W) of a folder, or (B, H, W, 3), by the numbers in their names; hidden files are left out.

    Other files, numbers that are missing and names that could have another order are logged as warnings.
    """
    there = sorted((f for f in path.iterdir() if f.name[0] != "." and f.is_file()), key=numbered)
    files = [f for f in there if f.suffix.lower() in KNOWN]
    if not files:
        raise FormatError(f"{path}: the folder has no pictures; known are {', '.join(sorted(KNOWN))}")
    if others := [f.name for f in there if f not in files]:
        _log.warning("%s: these files are no pictures of known kinds, and are left out: %s", path, some(others, 5))
    _check_order(path, files)
    frames = [_only(f, (load_png if f.suffix.lower() == ".png" else _of_tiff)(f, colour), 2 + colour) for f in files]
    kinds = {(frame.shape, str(frame.dtype)) for frame in frames}
    if len(kinds) > 1:
        raise FormatError(f"{path}: the pictures have different sizes or types: {sorted(kinds)}")
    return np.stack(frames)


def _check_order(path: Path, files: list[Path]) -> None:
    """Warn of names that count with decimals in another order, and of gaps in names that count by one step."""
    decimal = [re.split(r"([0-9]+(?:\.[0-9]+)?)", file.name) for file in files]
    numbers = [[float(part) for part in parts[1::2]] for parts in decimal]
    alike = len({tuple(parts[::2]) for parts in decimal}) == 1 and len(numbers[0]) == 1  # more numbers may be a date
    if alike and numbers != sorted(numbers):
        order = ", ".join(file.name for file in files[:3])
        _log.warning("%s: the order is %s, ...: give decimal numbers in names equally many digits", path, order)
    counted = [numbered(file) for file in files]
    varying = [set(parts) for parts in zip(*counted) if len(set(parts)) > 1]
    if len(varying) != 1 or len(files) < 3 or not all(isinstance(number, int) for number in varying[0]):
        return
    steps = np.diff(sorted(varying[0]))
    step = int(np.median(steps))
    if max(steps) > step and not (steps % step).any():
        lost = sum(steps) // step - len(steps)
        _log.warning("%s: numbers are missing in the names of its pictures: %d of %d", path, lost, lost + len(files))


def _of_tiff(path: Path, colour: bool) -> np.ndarray:
    arrays = load_tiff(path, colour)
    return next(iter(arrays.values())) if len(arrays) == 1 else np.empty(0)


def _only(path: Path, picture: np.ndarray, ndim: int) -> np.ndarray:
    if picture.ndim != ndim:
        raise FormatError(f"{path} holds several pictures: one of each file of a folder was expected")
    return picture


def save(path: Path, frames: np.ndarray) -> None:
    """Write frames (B, H, W) as PNGs."""
    if frames.ndim != 3:
        raise InputError(f"{path}: a folder of PNGs holds (frames, rows, columns), but {frames.shape} came")
    path.mkdir()
    for i, frame in enumerate(frames):
        save_png(path / f"frame_{i:04d}.png", frame)
