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
from pnp_sci.formats.arrays import load as arrays_of

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
    size : tuple of int
        Rows and columns of the raw pictures.
    full_scale : float or None
        The camera's largest value, in its units; None if it is not known.
    quality : Quality or None
        None if it was read from a file.
    """

    masks: np.ndarray
    dark: np.ndarray
    bad: np.ndarray
    crop: tuple[int, int, int, int]
    size: tuple[int, int]
    full_scale: float | None = None
    quality: Quality | None = None

    def __str__(self) -> str:
        return str(self.quality) if self.quality else repr(self)

    def __repr__(self) -> str:
        views, frames, rows, columns = self.masks.shape
        return f"Calibration({views} x {frames} masks of {rows} x {columns}, {int(self.bad.sum())} bad pixels)"

    @property
    def saturation(self) -> float | None:
        """The value at which measurements end, for ``Sensor(full_scale=...)``: full scale less the largest dark value.

        None if full scale is not known.

        Raises
        ------
        InputError
            If full scale is not above the largest dark value.
        """
        if self.full_scale is None or self.bad.all():
            return None
        largest = np.max(self.dark, where=~self.bad, initial=-np.inf)
        if not largest < self.full_scale < np.inf:
            raise InputError(
                f"full_scale is {self.full_scale}: more than the largest dark value, {largest}, was expected"
            )
        return float(np.float32(self.full_scale) - largest)

    @property
    def black_level(self) -> float:
        """The largest dark value, which full scale loses, for ``Sensor(black_level=...)``.

        0 if full scale is not known, that value is negative, or no pixel is usable.

        Raises
        ------
        InputError
            If full scale is not above the largest dark value.
        """
        saturation = self.saturation
        return 0.0 if self.full_scale is None or saturation is None else max(self.full_scale - saturation, 0.0)

    def correct(self, raw: Any) -> np.ma.MaskedArray:
        """Make measurements of raw pictures: cropped, the dark frame subtracted, bad pixels masked.

        If full scale is known, values end at `saturation` in all pixels, whatever their dark value.

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
            :func:`pnp_sci.solve` leaves masked pixels out. If some may be saturated, tell it by
            ``noise=pnp_sci.Sensor(full_scale=calibration.saturation, black_level=calibration.black_level)``.
        """
        pictures = real_array("raw", raw)
        if pictures.ndim not in (2, 3):
            raise InputError(f"raw has shape {pictures.shape}: (rows, columns) or (N, rows, columns) was expected")
        y = self.cropped("raw", pictures).astype(np.float32) - self.dark
        if self.saturation is not None:
            y = np.minimum(y, np.float32(self.saturation))
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
        numbers = {"crop": self.crop, "size": self.size}
        numbers |= {} if self.full_scale is None else {"full_scale": (self.full_scale,)}
        arrays = {"masks": self.masks, "dark": self.dark, "bad": self.bad}
        io.write(path, arrays | {name: np.array([values]) for name, values in numbers.items()})

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
        arrays, needed = arrays_of(Path(path)), ("masks", "dark", "bad", "crop", "size")
        if lacking := [name for name in needed if name not in arrays]:
            raise FormatError(f"{path} is no calibration: it lacks {', '.join(lacking)}")
        masks = io.read_masks(path, key="masks")
        dark, bad, crop, size = (arrays[name] for name in needed[1:])
        if not dark.shape == bad.shape == masks.shape[2:]:
            raise FormatError(f"{path}: masks {masks.shape}, dark {dark.shape} and bad {bad.shape} do not fit together")
        full_scales = arrays.get("full_scale", np.zeros(0))
        if (crop.size, size.size) != (4, 2) or full_scales.size > 1:
            raise FormatError(f"{path}: 4 numbers as crop, 2 as size and at most 1 as full_scale were expected")
        top, left, rows, columns, height, width = map(int, (*crop.flat, *size.flat))
        full_scale = float(full_scales.item()) if full_scales.size else None
        return cls(masks, dark, bad.astype(bool), (top, left, rows, columns), (height, width), full_scale)


def cut(name: str, pictures: np.ndarray, crop: tuple[int, ...], size: tuple[int, int]) -> np.ndarray:
    """The `crop` of pictures (..., H0, W0) whose `size` is (H0, W0); errors give `name`."""
    top, left, rows, columns = crop
    if pictures.shape[-2:] != size:
        have, want = (" x ".join(map(str, sides)) for sides in (pictures.shape[-2:], size))
        raise InputError(f"{name} is of {have} pixels, but patterns of {want}: the same pixels were expected")
    if pictures.shape[-2] < top + rows or pictures.shape[-1] < left + columns:
        have = " x ".join(map(str, pictures.shape[-2:]))
        raise InputError(f"{name} is of {have} pixels: {top + rows} x {left + columns} at least were expected")
    return pictures[..., top : top + rows, left : left + columns]
