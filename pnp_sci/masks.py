"""Coding masks: generation, and a report on how well they code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._validate import elements, finite_number, real_array, shown, whole
from pnp_sci.errors import InputError
from pnp_sci.sensing.operator import are_signed, as_masks

_SEPARABLE_FROM = 0.01  # smallest eigenvalue of the views' matrix of cosines: below it, noise grows more than tenfold
_CORRELATED_FROM = 0.5  # smallest correlation that a warning reports


def random_masks(shape: tuple[int, int, int, int], density: float = 0.5, seed: int = 0) -> np.ndarray:
    """Independent random binary masks.

    Parameters
    ----------
    shape : tuple
        (V, B, H, W): views, frames, rows, columns, each at least 1.
    density : float
        Probability that an element is open, in [0, 1].
    seed : int

    Returns
    -------
    ndarray of bool, (V, B, H, W)

    Raises
    ------
    InputError
        If `shape`, `density` or `seed` is out of its range.

    Examples
    --------
    >>> float(random_masks((2, 8, 32, 32)).mean().round(1))
    0.5
    """
    views, frames, rows, columns = _checked(shape, density, seed)
    return np.random.default_rng(seed).random((views, frames, rows, columns), np.float32) < density


def moving_masks(
    shape: tuple[int, int, int, int],
    density: float = 0.5,
    step: tuple[int, int] = (1, -1),
    view_shift: tuple[int, int] = (15, -18),
    seed: int = 0,
) -> np.ndarray:
    """Masks from one random binary pattern that moves, such as a mask on a translation stage.

    The mask of view v and frame b is the pattern shifted by ``b * step + v * view_shift``. The pattern is larger than
    the frame, so new elements enter at the edges. The default shifts are those of the dual-view benchmark (Lu et al.,
    OFaNet).

    Parameters
    ----------
    shape : tuple
        (V, B, H, W): views, frames, rows, columns, each at least 1.
    density : float
        Probability that an element is open, in [0, 1].
    step, view_shift : tuple of int
        Shift in pixels, (rows, columns), from one frame or one view to the next.
    seed : int

    Returns
    -------
    ndarray of bool, (V, B, H, W)

    Raises
    ------
    InputError
        If `shape`, `density` or `seed` is out of its range, or a shift is not two whole numbers.

    Examples
    --------
    >>> masks = moving_masks((2, 8, 32, 32))
    >>> bool((masks[0, 1, 1:, :-1] == masks[0, 0, :-1, 1:]).all())
    True
    """
    views, frames, rows, columns = _checked(shape, density, seed)
    each_view, each_frame = _shift("view_shift", view_shift), _shift("step", step)
    moves = np.arange(views)[:, None, None] * each_view + np.arange(frames)[:, None] * each_frame
    origin = moves.max((0, 1)) - moves
    extent = origin.max((0, 1)) + np.array([rows, columns])
    pattern = np.random.default_rng(seed).random(tuple(extent), np.float32) < density
    masks = np.empty((views, frames, rows, columns), bool)
    for v, b in np.ndindex(views, frames):
        top, left = origin[v, b]
        masks[v, b] = pattern[top : top + rows, left : left + columns]
    return masks


@dataclass(frozen=True)
class MaskCondition:
    """Properties of masks, measured by :func:`condition`; ``str()`` of it is a report.

    Attributes
    ----------
    shape : tuple
        (V, B, H, W)
    dtype : str
        Type of the given masks.
    levels : int
        Number of distinct values; 2 for binary masks.
    minimum, maximum : float
        Range of the values.
    density : float
        Mean value divided by the largest magnitude: the fraction of transmitted light.
    closed : tuple of float
        For each view, the fraction of pixels whose masks are 0 in all frames.
    closed_in_all : float
        Fraction of pixels whose masks are 0 in all frames of all views; nothing is measured there.
    gram_min, gram_max : float
        Range over pixels of ``sum(masks**2)``, the diagonal of Phi Phi^T.
    view_correlation : float
        Largest magnitude of the correlation between the mask stacks of two views; 0 for one view.
    frame_correlation : float
        Largest magnitude of the correlation between two frames of a view; 1 if two frames have the same mask, 0 for one
        frame.
    separable : bool
        Whether the smallest eigenvalue of the matrix of cosines between the views' mask stacks is at least 0.01. Below
        it, a view is closed or nearly a linear combination of the others, and noise grows more than tenfold.
    signed : bool
        Whether masks are negative by more than the noise of a calibration: by 1 % of the sum of all magnitudes.
    """

    shape: tuple[int, int, int, int]
    dtype: str
    levels: int
    minimum: float
    maximum: float
    density: float
    closed: tuple[float, ...]
    closed_in_all: float
    gram_min: float
    gram_max: float
    view_correlation: float
    frame_correlation: float
    separable: bool
    signed: bool

    @property
    def warnings(self) -> tuple[str, ...]:
        """Problems of these masks, one sentence each; empty if there are none."""
        concerns = {
            f"{self.closed_in_all:.1%} of the pixels are closed in all views: there nothing is measured.": (
                self.closed_in_all > 0
            ),
            "The views cannot be told apart: their masks are too much alike, or those of one view are all closed.": (
                self.shape[0] > 1 and not self.separable
            ),
            f"Masks of two views have correlation {self.view_correlation:.2f}: expect one view to show in the other.": (
                self.separable and self.view_correlation > _CORRELATED_FROM
            ),
            f"Masks of two frames have correlation {self.frame_correlation:.2f}: expect motion between them to blur.": (
                self.frame_correlation > _CORRELATED_FROM
            ),
            "All masks are the same and uniform: nothing is coded.": self.levels == 1,
            "Some values are negative: no camera makes such masks without subtracting two pictures.": self.signed,
        }
        return tuple(sentence for sentence, holds in concerns.items() if holds)

    def __str__(self) -> str:
        views, frames, rows, columns = self.shape
        kind = "binary" if self.levels <= 2 else f"{self.levels} levels"
        closed = ", ".join(f"{fraction:.2%}" for fraction in self.closed)
        lines = [
            f"Masks: {views} views x {frames} frames of {rows} x {columns}, {self.dtype}, {kind} "
            f"from {self.minimum:g} to {self.maximum:g}",
            f"Light that passes: {self.density:.1%}",
            f"Closed pixels: {closed} by view; {self.closed_in_all:.2%} in all views",
            f"Gram (sum of squared masks): {self.gram_min:g} to {self.gram_max:g}",
            f"Correlation between frames: {self.frame_correlation:.3f}",
        ]
        if views > 1:
            lines.append(
                f"Correlation between views: {self.view_correlation:.3f}; the views "
                f"{'can' if self.separable else 'cannot'} be told apart"
            )
        return "\n".join(lines + [f"Warning: {sentence}" for sentence in self.warnings])


def condition(masks: Any) -> MaskCondition:
    """Measure how well masks code.

    Parameters
    ----------
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
        Any finite real values.

    Returns
    -------
    MaskCondition

    Raises
    ------
    InputError, InputTypeError
        If masks are not finite real numbers (V, B, H, W).

    Examples
    --------
    >>> print(condition(random_masks((2, 1, 32, 32))).warnings[0])
    27.0% of the pixels are closed in all views: there nothing is measured.
    """
    checked = as_masks(masks)
    largest = max(abs(float(checked.min())), abs(float(checked.max())))
    scaled = checked.astype(np.float64) / (largest or 1)
    gram = np.einsum("vbhw,vbhw->hw", scaled, scaled) * largest**2
    open_ = checked.any(axis=1)
    centred = scaled - scaled.mean((1, 2, 3), keepdims=True)
    between_frames = [_correlations(view - view.mean((1, 2), keepdims=True)) for view in scaled]
    return MaskCondition(
        shape=checked.shape,  # type: ignore[arg-type]
        dtype=str(np.asarray(getattr(masks, "masks", masks)).dtype),
        levels=np.unique(checked).size,
        minimum=float(checked.min()),
        maximum=float(checked.max()),
        density=float(scaled.mean()),
        closed=tuple(float(x) for x in 1 - open_.mean((1, 2))),
        closed_in_all=float(1 - open_.any(0).mean()),
        gram_min=float(gram.min()),
        gram_max=float(gram.max()),
        view_correlation=_largest_off_diagonal(_correlations(centred)),
        frame_correlation=max(_largest_off_diagonal(matrix) for matrix in between_frames),
        separable=views_are_separable(checked),
        signed=are_signed(checked),
    )


def views_are_separable(masks: np.ndarray) -> bool:
    """Whether the views of masks (V, B, H, W) can be separated, see :attr:`MaskCondition.separable`.

    It processes one frame after the other, to save memory.
    """
    largest = max(-float(masks.min()), float(masks.max())) or 1.0
    frames = ((frame / largest).reshape(len(masks), -1).astype(np.float64) for frame in masks.swapaxes(0, 1))
    products = sum(np.einsum("vp,wp->vw", frame, frame) for frame in frames)
    return bool(np.linalg.eigvalsh(_cosines(np.asarray(products), masks[0].size))[0] >= _SEPARABLE_FROM)


def _correlations(stacks: np.ndarray) -> np.ndarray:
    """Cosines (n, n) between the entries of the first axis; 0 for entries of negligible norm."""
    flat = stacks.reshape(len(stacks), -1)
    return _cosines(flat @ flat.T, flat.shape[1])


def _cosines(products: np.ndarray, values: int) -> np.ndarray:
    """Cosines from inner `products` (n, n) of vectors of `values` values of at most 1; 0 for negligible norms."""
    norms = np.sqrt(np.diagonal(products))
    norms = np.where(norms > 1e-12 * values**0.5, norms, np.inf)
    return products / norms[:, None] / norms


def _largest_off_diagonal(matrix: np.ndarray) -> float:
    return float(np.abs(matrix - np.diag(np.diagonal(matrix))).max())


def _checked(shape: Any, density: Any, seed: Any) -> tuple[int, ...]:
    sizes = elements(shape) or ()
    if len(sizes) != 4 or not all(isinstance(n, int | np.integer) and n >= 1 for n in sizes):
        raise InputError(f"shape is {shown(shape)}: (views, frames, rows, columns) was expected, whole numbers >= 1")
    if finite_number("density", density, "a number in [0, 1]") > 1:
        raise InputError(f"density is {shown(density)}: a number in [0, 1] was expected")
    whole("seed", seed, 0)
    return tuple(int(n) for n in sizes)


def _shift(name: str, value: Any) -> np.ndarray:
    shift = real_array(name, value)
    if shift.shape != (2,) or shift.dtype.kind not in "iu":
        raise InputError(f"{name} is {shown(value)}: two whole numbers, (rows, columns), were expected")
    return shift
