"""Consecutive measurements of one video: one operator for all of them."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np

from pnp_sci._validate import elements, shown
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.operator import SensingOperator


class SequenceOperator(SensingOperator):
    """The operator of N consecutive measurements: maps a video of N times B frames to N pictures.

    ``y[n] = sum over views v and frames b of masks[n, v, b] * x[v, n B + b]``

    A prior sees the frames of all measurements as one video, so that motion continues from one to the next.

    Parameters
    ----------
    parts : sequence of SensingOperator
        Of each measurement, all of the same shape and dtype. One operator may be repeated.

    Attributes
    ----------
    shape : tuple
        (V, N * B, H, W)
    pictures : tuple
        (N, H, W)
    gram : ndarray, (N, H, W)

    Raises
    ------
    InputError, InputTypeError
        If there are no parts, they differ in shape or dtype, or are no operators.

    Examples
    --------
    >>> part = SensingOperator(np.ones((1, 2, 4, 4)))
    >>> op = SequenceOperator([part, part, part])
    >>> op.shape, op.forward(np.ones(op.shape)).shape
    ((1, 6, 4, 4), (3, 4, 4))
    """

    def __init__(self, parts: Sequence[SensingOperator]):
        if (given := elements(parts)) is None:
            raise InputTypeError(f"parts is {shown(parts)}: a sequence of operators was expected")
        for part in given:
            if not isinstance(part, SensingOperator):
                raise InputTypeError(f"parts has {type(part).__name__}: operators were expected")
        kinds = {(part.shape, part.dtype) for part in given}
        if len(kinds) != 1:
            raise InputError(f"parts has operators of {len(kinds)} shapes and types: one was expected")
        self._parts = given
        views, frames, *picture = given[0].shape
        self.shape, self.dtype = (views, len(given) * frames, *picture), given[0].dtype  # type: ignore[assignment]

    def __repr__(self) -> str:
        return f"SequenceOperator({len(self.parts)} times {self.parts[0]!r})"

    @property
    def parts(self) -> tuple[SensingOperator, ...]:
        """The operators of the single measurements."""
        return self._parts

    @property
    def masks(self) -> np.ndarray:  # type: ignore[override]
        """Those of each measurement, (N, V, B, H, W), as a new array."""
        return np.stack([part.masks for part in self.parts])

    @property
    def pictures(self) -> tuple[int, ...]:
        """Shape of y, (N, H, W)."""
        return len(self.parts), *self.shape[2:]

    @cached_property
    def gram(self) -> np.ndarray:
        """The diagonal of Phi Phi^T, (N, H, W)."""
        return np.stack([part.gram for part in self.parts])

    def crop(self, where: tuple[slice, slice]) -> SequenceOperator:
        """The operator of a part of the picture, rows and columns."""
        crops = {id(part): part.crop(where) for part in self.parts}
        return SequenceOperator([crops[id(part)] for part in self.parts])

    def forward(self, x: Any, out: np.ndarray | None = None) -> np.ndarray:
        """Phi x: the measurements (N, H, W) of a video (V, N * B, H, W)."""
        videos, y = split(self._array("x", x, self.shape), len(self.parts)), self._output(out, self.pictures)
        for part, video, picture in zip(self.parts, videos, y):
            part.forward(video, picture)
        return y

    def adjoint(self, y: Any, out: np.ndarray | None = None) -> np.ndarray:
        """Phi^T y: each measurement (H, W) of y (N, H, W) times each of its masks, (V, N * B, H, W)."""
        y, x = self._array("y", y, self.pictures), self._output(out, self.shape)
        for part, picture, video in zip(self.parts, y, split(x, len(self.parts))):
            video[...] = part.adjoint(picture)
        return x

    def project(self, x: Any, y: Any, rho: float | np.ndarray = 0.0, out: np.ndarray | None = None) -> np.ndarray:
        """``x + Phi^T (y - Phi x) / (gram + rho)``; see :meth:`SensingOperator.project`, rho may be (N, H, W)."""
        count = len(self.parts)
        x, y, out = self._array("x", x, self.shape), self._array("y", y, self.pictures), self._output(out, self.shape)
        rhos = self._array("rho", rho, self.pictures) if np.ndim(rho) else [rho] * count
        for part, video, picture, weight, projected in zip(self.parts, split(x, count), y, rhos, split(out, count)):
            projected[...] = part.project(video, picture, weight)
        return out


def split(x: Any, count: int) -> Any:
    """The videos (N, V, B, H, W) of `count` measurements, a view of their video x (V, N * B, H, W), array or tensor.

    >>> split(np.ones((2, 6, 4, 5)), 3).shape
    (3, 2, 2, 4, 5)
    """
    return x.reshape(len(x), count, -1, *x.shape[2:]).swapaxes(0, 1)


def joined(videos: Sequence[np.ndarray]) -> np.ndarray:
    """The video (V, N * B, H, W) of the videos (V, B, H, W) of consecutive measurements."""
    return np.concatenate(videos, axis=1) if len(videos) > 1 else videos[0]
