"""Sensors with colour filters: which pixel sees which colour, luma and chroma of what they see, and demosaicing.

A pixel of y sees one colour of the scene. So the raw picture of the scene, its mosaic, obeys the same equation as a
grey video. Within the solver a mosaic lies in planes: four quarters, each with the pixels of one place of the cells of
2 x 2 pixels. Neighbours in a plane have the same colour, as rules that compare neighbours need it.
The equation stays the same when pixels of y, masks and video change their order together.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._validate import one_of, real_array
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import SensingOperator

PATTERNS = ("RGGB", "BGGR", "GRBG", "GBRG")
CELL = ((0, 0), (0, 1), (1, 0), (1, 1))  # rows and columns of the four pixels of a cell
# Binomial weights (1, 4, 6, 4, 1) / 8 between the pixels of a plane, averaged over a cell: of the plane before, at and
# after the cell, for its first and its second row or column. Linear ramps stay, the alternation of planes is removed.
TO_CELL = (np.array([1, 10, 5]) / 16, np.array([5, 10, 1]) / 16)
TO_PIXEL = (np.array([1, 3, 0]) / 4, np.array([0, 3, 1]) / 4)  # linear interpolation, from the cells to their pixels
DARKEST = 0.05  # of the brightest colour: a colour that is fainter in the whole scene is not raised further


def check_cells(name: str, shape: tuple[int, ...]) -> None:
    """Raise an InputError if pictures (..., H, W) of this shape are no whole cells."""
    if len(shape) < 2 or shape[-2] % 2 or shape[-1] % 2:
        raise InputError(f"{name} has shape {shape}: even rows and columns were expected, in cells of 2 x 2 pixels")


def planes(picture: Any) -> np.ndarray:
    """A mosaic in planes: quarters (H / 2, W / 2), one for each pixel of the cells.

    Parameters
    ----------
    picture : array_like, (..., H, W)

    Returns
    -------
    ndarray, (..., H, W)

    Raises
    ------
    InputError, InputTypeError
        If it holds no real numbers, or no whole cells: H or W is odd.

    Examples
    --------
    >>> import numpy as np
    >>> planes(np.arange(16).reshape(4, 4))[:2, :2]
    array([[ 0,  2],
           [ 8, 10]])
    """
    picture = real_array("picture", picture)
    check_cells("picture", picture.shape)
    return np.concatenate(
        [np.concatenate([picture[..., i::2, j::2] for j in (0, 1)], axis=-1) for i in (0, 1)], axis=-2
    )


def quarters(shape: tuple[int, ...]) -> list[tuple[slice, slice]]:
    """Rows and columns of the four planes of pictures (..., H, W)."""
    rows, columns = (n // 2 for n in shape[-2:])
    return [(slice(i * rows, (i + 1) * rows), slice(j * columns, (j + 1) * columns)) for i, j in CELL]


@dataclass(frozen=True)
class Mosaic:
    """The colour filters of a sensor.

    Attributes
    ----------
    pattern : str
        Colours of the first two pixels of the first row and of the second: "RGGB", "BGGR", "GRBG" or "GBRG".

    Raises
    ------
    InputError
        If the pattern is another one.

    References
    ----------
    D. Alleysson, S. Süsstrunk & J. Hérault, "Linear demosaicing inspired by the human visual system", IEEE TIP 14
    (2005).

    Examples
    --------
    >>> mosaic = Mosaic("RGGB")
    >>> mosaic.sample(np.ones((4, 4, 3)) * [0.2, 0.5, 0.8])[:2, :2]
    array([[0.2, 0.5],
           [0.5, 0.8]])
    """

    pattern: str

    def __post_init__(self):
        one_of("mosaic", self.pattern, PATTERNS)

    @property
    def colours(self) -> list[int]:
        """The colour of each pixel of a cell: 0 red, 1 green, 2 blue."""
        return ["RGB".index(colour) for colour in self.pattern]

    def sample(self, video: Any) -> np.ndarray:
        """What the sensor sees of a colour video (..., H, W, 3): its mosaic (..., H, W).

        Parameters
        ----------
        video : array_like, (..., H, W, 3)

        Returns
        -------
        ndarray, (..., H, W)

        Raises
        ------
        InputError, InputTypeError
            If it is not in colour.
        """
        video = real_array("video", video)
        if video.ndim < 3 or video.shape[-1] != 3:
            raise InputError(f"video has shape {video.shape}: (..., rows, columns, 3) was expected")
        out = np.empty(video.shape[:-1], video.dtype)
        for (i, j), colour in zip(CELL, self.colours):
            out[..., i::2, j::2] = video[..., i::2, j::2, colour]
        return out

    def gains(self, y: np.ndarray, op: SensingOperator) -> np.ndarray:
        """How bright each colour is beside the brightest, (3,): at most 1. y (..., H, W) and masks lie in planes.

        The root mean square of y over that of the masks, as masks may have been measured through the filters.

        Parameters
        ----------
        y : ndarray, (..., H, W)
            In planes.
        op : SensingOperator
            Of masks in planes.
        """
        light = np.zeros((2, 3))
        weights = op.masks.sum((0, 1), dtype=np.float64) ** 2 + op.gram
        for colour, plane, weight in zip(self.colours, _quarters(y.astype(np.float64)), _quarters(weights)):
            light[:, colour] += np.mean(plane**2), np.mean(weight)
        seen, through = np.sqrt(light)
        brightness = np.divide(seen, through, out=np.zeros(3), where=through > 1e-6 * through.max())
        largest = brightness.max()
        return np.maximum(brightness / largest, DARKEST) if largest > 0 else np.ones(3)

    def spread(self, values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """A value for each colour as a picture (H, W) in planes.

        Parameters
        ----------
        values : ndarray, (3,)
        shape : tuple of int
            (..., H, W)
        """
        out = np.empty(shape[-2:], values.dtype)
        for colour, plane in zip(self.colours, _quarters(out)):
            plane[...] = values[colour]
        return out

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Luma (V, B, H, W), in the order of the sensor, and chroma (2 V, B, H / 2, W / 2) of a video x in planes.

        Chroma are the red-blue and the green-magenta contrast of each cell, both with weights of norm 1. Luma is
        what the mosaic has beyond the colour that they give each of its pixels, so that :meth:`join` returns x.

        Parameters
        ----------
        x : ndarray, (V, B, H, W)
            In planes.
        """
        at_cell = [_filtered(plane, TO_CELL[i], TO_CELL[j]) for (i, j), plane in zip(CELL, _quarters(x))]
        red, first, second, blue = (at_cell[k] for k in np.argsort(self.colours, kind="stable"))
        chroma = np.concatenate([(red - blue) / np.sqrt(2), (red + blue - first - second) / 2]).astype(x.dtype)
        luma = np.empty_like(x)
        for (i, j), plane, offset in zip(CELL, _quarters(x), self._offsets(chroma)):
            np.subtract(plane, offset, out=luma[..., i::2, j::2])
        return luma, chroma

    def join(self, luma: np.ndarray, chroma: np.ndarray) -> np.ndarray:
        """The video (V, B, H, W) in planes of this luma and chroma; the inverse of :meth:`split`.

        Parameters
        ----------
        luma : ndarray, (V, B, H, W)
        chroma : ndarray, (2 V, B, H / 2, W / 2)
        """
        out = np.empty_like(luma)
        for (i, j), plane, offset in zip(CELL, _quarters(out), self._offsets(chroma)):
            np.add(luma[..., i::2, j::2], offset, out=plane)
        return out

    def demosaic(self, x: np.ndarray) -> np.ndarray:
        """The colour video (V, B, H, W, 3), in the order of the sensor, of a video x (V, B, H, W) in planes.

        Pixels keep the colour that the sensor sees. The others have their luma and the chroma around.

        Parameters
        ----------
        x : ndarray, (V, B, H, W)
            In planes.
        """
        luma, chroma = self.split(x)
        out = np.empty((*x.shape, 3), x.dtype)
        for i, j in CELL:
            for colour, offset in enumerate(_by_colour(chroma)):
                pixels = _filtered(offset, TO_PIXEL[i], TO_PIXEL[j])
                np.add(luma[..., i::2, j::2], pixels, out=out[..., i::2, j::2, colour])
        return out

    def _offsets(self, chroma: np.ndarray) -> Iterator[np.ndarray]:
        """What chroma adds to the luma of the pixels of each plane, (V, B, H / 2, W / 2)."""
        by_colour = _by_colour(chroma)
        for (i, j), colour in zip(CELL, self.colours):
            yield _filtered(by_colour[colour], TO_PIXEL[i], TO_PIXEL[j])


def _by_colour(chroma: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What chroma (2 V, B, H / 2, W / 2) adds to the red, green and blue of each cell."""
    red_blue, green_magenta = np.split(chroma, 2)
    return red_blue / np.sqrt(2) + green_magenta / 2, -green_magenta / 2, green_magenta / 2 - red_blue / np.sqrt(2)


def _quarters(x: np.ndarray) -> list[np.ndarray]:
    """The four planes (..., H / 2, W / 2) of x (..., H, W), views of it."""
    return [x[(..., *where)] for where in quarters(x.shape)]


def _filtered(plane: np.ndarray, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """A plane (..., h, w) correlated with three weights along its rows' direction and three along its columns'."""
    from scipy.ndimage import correlate1d

    down = correlate1d(plane, rows, axis=-2, mode="nearest")
    return correlate1d(down, columns, axis=-1, mode="nearest")
