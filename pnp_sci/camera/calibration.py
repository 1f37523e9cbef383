"""A camera's calibration: masks, dark frame and bad pixels, in files and in use."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci import io
from pnp_sci._validate import real_array
from pnp_sci.camera.quality import Quality
from pnp_sci.errors import FormatError, InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """What turns raw pictures into measurements, made by :func:`calibrate`; ``str()`` of it is a report.

    Attributes
    ----------
    masks : ndarray of float32, (V, B, H, W)
        What of the lamp's light arrives at a pixel: 1 is the median of `white`. The lens's shading is part of them, so
        that recovered videos have none.
    dark : ndarray of float32, (H, W)
        The camera's signal without light, in its units.
    bad : ndarray of bool, (H, W)
        Hot, noisy, dead and saturated pixels.
    crop : tuple of int
        (top, left, rows, columns) of the part of the raw pictures that all arrays cover.
    quality : Quality or None
        None if it was read from a file.
    size : tuple of int or None
        Rows and columns of the raw pictures; None if an older file does not tell them.
    """

    masks: np.ndarray
    dark: np.ndarray
    bad: np.ndarray
    crop: tuple[int, int, int, int]
    quality: Quality | None = None
    size: tuple[int, int] | None = None

    def __str__(self) -> str:
        return str(self.quality) if self.quality else repr(self)

    def __repr__(self) -> str:
        views, frames, rows, columns = self.masks.shape
        return f"Calibration({views} x {frames} masks of {rows} x {columns}, {int(self.bad.sum())} bad pixels)"

    def correct(self, raw: Any) -> np.ma.MaskedArray:
        """Make measurements of raw pictures: cropped, the dark frame subtracted, bad pixels masked.

        Parameters
        ----------
        raw : array_like, (H0, W0) or (N, H0, W0)

        Raises
        ------
        InputError, InputTypeError
            If the pictures have another size than those of the calibration, or are no real numbers.

        Returns
        -------
        MaskedArray of float32, (H, W) or (N, H, W)
            :func:`pnp_sci.solve` leaves masked pixels out.
        """
        pictures = real_array("raw", raw)
        if pictures.ndim not in (2, 3):
            raise InputError(f"raw has shape {pictures.shape}: (rows, columns) or (N, rows, columns) was expected")
        y = self.cropped("raw", pictures).astype(np.float32) - self.dark
        return np.ma.MaskedArray(y, np.broadcast_to(self.bad, y.shape))

    def cropped(self, name: str, pictures: np.ndarray) -> np.ndarray:
        """The part of pictures as large as the raw ones that all arrays cover.

        Parameters
        ----------
        name : str
            What errors call the pictures.
        pictures : ndarray, (..., H0, W0)

        Returns
        -------
        ndarray, (..., H, W)

        Raises
        ------
        InputError
            If they have another size.
        """
        return cut(name, pictures, self.crop, self.size)

    def plot(self) -> Figure:
        """Pictures of the calibration: dark frame, shading, masks, bad pixels, values, brightness of the lamp."""
        from pnp_sci.camera.pictures import draw

        return draw(self)

    def save(self, path: str | Path) -> None:
        """Write NPZ, HDF5 or MAT, which ``read_masks`` and :meth:`load` read; the quality is not kept.

        Parameters
        ----------
        path : path
        """
        size = {} if self.size is None else {"size": np.array([self.size])}
        arrays = {"masks": self.masks, "dark": self.dark, "bad": self.bad, "crop": np.array([self.crop])}
        io.write(path, arrays | size)

    @classmethod
    def load(cls, path: str | Path) -> Calibration:
        """Read what :meth:`save` wrote.

        Parameters
        ----------
        path : path

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        FormatError
            If it is damaged or holds no calibration.
        """
        there = {entry.key for entry in io.describe(path)}
        if lacking := {"masks", "dark", "bad", "crop"} - there:
            raise FormatError(f"{path} is no calibration: it lacks {', '.join(sorted(lacking))}")
        masks = io.read_masks(path, key="masks")
        dark, bad, crop = (io.read(path, key) for key in ("dark", "bad", "crop"))
        if not (dark.shape == bad.shape == masks.shape[2:] and crop.size == 4):
            raise FormatError(f"{path}: masks {masks.shape}, dark {dark.shape} and bad {bad.shape} do not fit together")
        top, left, rows, columns = map(int, crop.ravel())
        known = "size" in there
        height, width = map(int, io.read(path, "size").ravel()) if known else (0, 0)
        return cls(masks, dark, bad.astype(bool), (top, left, rows, columns), size=(height, width) if known else None)


def cut(name: str, pictures: np.ndarray, crop: tuple[int, ...], size: tuple[int, int] | None) -> np.ndarray:
    """The `crop` of pictures (..., H0, W0) whose `size` is (H0, W0), where that is known; errors give `name`."""
    top, left, rows, columns = crop
    if size is not None and pictures.shape[-2:] != size:
        have, want = (" x ".join(map(str, sides)) for sides in (pictures.shape[-2:], size))
        raise InputError(f"{name} is of {have} pixels, but patterns of {want}: the same pixels were expected")
    if pictures.shape[-2] < top + rows or pictures.shape[-1] < left + columns:
        have = " x ".join(map(str, pictures.shape[-2:]))
        raise InputError(f"{name} is of {have} pixels: {top + rows} x {left + columns} at least were expected")
    return pictures[..., top : top + rows, left : left + columns]
