"""Masks moved over the picture: shift, rotation about the centre, scale, and blur."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

ORDERS = {"linear": 1, "cubic": 3}  # interpolation: degree of the spline


@dataclass(frozen=True)
class Transform:
    """A motion of masks over the picture: about its centre c, an element at q goes to ``c + shift + scale R (q - c)``.

    Attributes
    ----------
    rows, columns : float
        Shift in pixels, down and right.
    rotation : float
        Degrees, counter-clockwise as the picture is seen.
    scale : float
        > 0; above 1 the masks grow.
    blur : float
        Variance, in pixels squared, of a Gaussian that blurs the moved masks.

    Examples
    --------
    >>> Transform(rotation=90).moved(np.array([[0.0, 1.0]]), (3, 3)).round(6) + 0.0
    array([[1., 0.]])
    """

    rows: float = 0.0
    columns: float = 0.0
    rotation: float = 0.0
    scale: float = 1.0
    blur: float = 0.0

    @property
    def shift(self) -> np.ndarray:
        """Shift along rows and columns, (2,)."""
        return np.array([self.rows, self.columns])

    def moved(self, points: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """Where the elements at `points` (N, 2), in rows and columns of pictures of this shape, go."""
        return centre(shape) + self.shift + (points - centre(shape)) @ self._matrix().T

    def displacement(self, shape: tuple[int, ...], other: Transform | None = None) -> float:
        """The farthest way, in pixels, that a corner of the picture goes, or from where another transform leads it."""
        rows, columns = np.array(shape[-2:]) - 1
        corners = np.array([[0, 0], [0, columns], [rows, 0], [rows, columns]], float)
        begin = corners if other is None else other.moved(corners, shape)
        return float(np.linalg.norm(self.moved(corners, shape) - begin, axis=1).max())

    def inverse(self, shape: tuple[int, ...]) -> tuple[np.ndarray, np.ndarray]:
        """Matrix (2, 2) and offset (2,) that lead from a pixel to the mask element that it sees."""
        back = np.linalg.inv(self._matrix())
        return back, centre(shape) - back @ (centre(shape) + self.shift)

    def _matrix(self) -> np.ndarray:
        angle = np.deg2rad(self.rotation)
        return self.scale * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def centre(shape: tuple[int, ...]) -> np.ndarray:
    """Row and column of the centre of pictures of this shape."""
    return (np.array(shape[-2:]) - 1) / 2


def warped(planes: np.ndarray, transform: Transform, interpolation: str) -> np.ndarray:
    """Planes (..., H, W) after the transform, float64; what comes in from outside is as the nearest element.

    Parameters
    ----------
    planes : ndarray, (..., H, W)
    transform : Transform
    interpolation : "linear" or "cubic"
        Linear is what a pixel sees of sharp elements as large as itself. Cubic keeps more of the contrast.

    Examples
    --------
    >>> warped(np.eye(3), Transform(columns=0.5), "linear")[1]
    array([0. , 0.5, 0.5])
    """
    from scipy.ndimage import affine_transform

    matrix, offset = transform.inverse(planes.shape)
    order = 0 if transform == Transform(round(transform.rows), round(transform.columns)) else ORDERS[interpolation]
    out = np.empty(planes.shape, np.float64)
    for place in np.ndindex(planes.shape[:-2]):
        plane = planes[place].astype(np.float64)
        affine_transform(plane, matrix, offset.tolist(), output=out[place], order=order, mode="nearest")
    return spread(out, transform.blur) if transform.blur else out


def spread(planes: np.ndarray, variance: float, derivative: bool = False) -> np.ndarray:
    """Planes (..., H, W) blurred by a Gaussian of this variance, or the derivative of that by the variance.

    The Gaussian is ``exp(-variance |w|^2 / 2)`` in the frequencies w of a cosine transform: the borders are mirrors. A
    negative variance sharpens.

    Examples
    --------
    >>> bool(np.allclose(spread(spread(np.eye(8), 0.3), -0.3), np.eye(8)))
    True
    """
    from scipy.fft import dctn, idctn

    axes = [np.pi * np.arange(n) / n for n in planes.shape[-2:]]
    half = (axes[0][:, None] ** 2 + axes[1] ** 2) / 2
    gain = np.exp(-variance * half)
    return idctn(np.asarray(dctn(planes, axes=(-2, -1))) * (-half * gain if derivative else gain), axes=(-2, -1))  # type: ignore[return-value]


def known(transform: Transform, shape: tuple[int, ...], margin: float = 0.0) -> np.ndarray:
    """Pixels (H, W) whose mask element lies in the given masks, this far from their border at least."""
    rows, columns = shape[-2:]
    matrix, offset = transform.inverse(shape)
    seen = np.einsum("ij,jhw->ihw", matrix, np.indices((rows, columns))) + offset[:, None, None]
    last = np.array([rows - 1, columns - 1])[:, None, None]
    rounding = 1e-9
    return ((seen >= margin - rounding) & (seen <= last - margin + rounding)).all(0)
