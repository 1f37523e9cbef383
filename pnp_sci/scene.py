"""What a scene requires: which views hold anything, and whether anything moves."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .loop import iterate
from .operator import SensingOperator
from .problem import level
from .protocols import Denoiser

DARK = 0.08  # of the brightest view's level: below, a view may be absent
TILE = 96  # pixels a side of the crop on which models are compared
HELD_BACK = 0.1  # of the pixels of y, to be predicted
ITERATIONS = 60  # of the quick estimates; with fewer the full model has not shown yet what it can do
EARLY = 20  # iterations that show where the simple model fits worst, and sometimes that the full one is better
CLEARLY = 0.8  # of the full model's squared error beyond the noise: on 10 scenes from clips of the training set and of
# the benchmark, whole and cropped, still ones had 0.45 to 0.74 of it and moving ones 0.89 to 4.7


@dataclass(frozen=True)
class SceneModel:
    """What is modelled of a scene.

    Attributes
    ----------
    views : tuple of bool
        Which views hold anything; the others come out as 0.
    still : bool
        Whether one frame per view stands for all of them.
    reason : str
        In words.
    """

    views: tuple[bool, ...]
    still: bool = False
    reason: str = "as asked for"

    @property
    def complete(self) -> bool:
        """Whether every view and frame is modelled; then nothing is copied."""
        return all(self.views) and not self.still

    def reduce(self, op: SensingOperator) -> SensingOperator:
        """The operator of what is modelled: masks of the views there are, summed over time if nothing moves."""
        if self.complete:
            return op
        masks = op.masks[np.array(self.views)]
        if self.still:
            masks = masks.sum(1, keepdims=True, dtype=op.dtype)
        return SensingOperator(masks, op.dtype)

    def restrict(self, x: np.ndarray) -> np.ndarray:
        """Of a video (V, B, H, W), what is modelled."""
        if self.complete:
            return x
        kept = x[np.array(self.views)]
        return kept.mean(1, keepdims=True) if self.still else kept

    def expand(self, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """The video (V, B, H, W) of what was modelled."""
        if self.complete:
            return x
        full = np.zeros(shape, x.dtype)
        full[np.array(self.views)] = x
        return full

    def describe(self, op: SensingOperator) -> dict[str, Any]:
        """For `Result.scene`."""
        views, frames = op.shape[:2]
        modelled = sum(self.views) * (1 if self.still else frames)
        return asdict(self) | {"frames_modelled": modelled, "frames": views * frames}


def full(op: SensingOperator, reason: str = "as asked for") -> SceneModel:
    """Everything is modelled."""
    return SceneModel((True,) * op.shape[0], False, reason)


def judge(op: SensingOperator, y: np.ndarray, noise: float, denoiser: Denoiser) -> SceneModel:
    """What this measurement requires to be modelled, from the measurement alone.

    Simpler models are tried against the full one: without the views whose level is near 0, and with one frame per view.
    On the crop where the simple model fits worst a tenth of the pixels of y is held back, both models are estimated
    quickly from the rest, and the simple one is taken if it predicts what was held back clearly better.

    Parameters
    ----------
    op : SensingOperator
    y : ndarray, (H, W)
        In units where x spans about [0, 1].
    noise : float
        Standard deviation of the noise of y.
    denoiser : Denoiser
        For the quick estimates, such as TV.
    """
    chosen = full(op, "every view and frame is needed")
    levels = view_levels(op, y)
    lit = tuple(bool(v) for v in levels > DARK * levels.max())
    if not all(lit) and any(lit):
        dark = ", ".join(str(v + 1) for v, on in enumerate(lit) if not on)
        without = SceneModel(lit, False, f"view {dark} is dark: y is explained without it")
        if _predicts_better(op, y, noise, denoiser, without, chosen):
            chosen = without
    if op.shape[1] > 1:
        so_far = "" if chosen.complete else chosen.reason + "; "
        still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
        if _predicts_better(op, y, noise, denoiser, still, chosen):
            chosen = still
    return chosen


def view_levels(op: SensingOperator, y: np.ndarray) -> np.ndarray:
    """The mean level of each view (V,): least squares of y on the sums of each view's masks, freed of their means.

    The sums differ from pixel to pixel by the random pattern only, which no scene follows, so that the part of y that
    follows them is the view's own. A constant and both views' common part stay out of it.
    """
    from scipy.ndimage import gaussian_filter

    sums = op.masks.sum(1, dtype=np.float64)
    fine = np.stack([s - gaussian_filter(s, 4, mode="nearest") for s in sums]).reshape(len(sums), -1)
    detail = (y - gaussian_filter(y.astype(np.float64), 4, mode="nearest")).reshape(-1)
    normal = np.einsum(
        "vp,wp->vw", fine, fine
    )  # by einsum: threads of BLAS go on spinning and keep the kernels waiting
    # below 1e-10 of the largest eigenvalue there is rounding: such views cannot be told apart, and share what there is
    return np.abs(np.linalg.pinv(normal, rcond=1e-10, hermitian=True) @ np.einsum("vp,p->v", fine, detail))


def _predicts_better(
    op: SensingOperator, y: np.ndarray, noise: float, denoiser: Denoiser, simple: SceneModel, other: SceneModel
) -> bool:
    """Whether the simple model predicts pixels of y held back clearly better, on the tile where it has most trouble."""
    seen = np.random.default_rng(0).random(y.shape) >= HELD_BACK
    error = next(_prediction_errors(simple.reduce(op), y, seen, noise, denoiser, EARLY))
    crop = _worst_tile(error**2)
    part, y, seen = SensingOperator(op.masks[(..., *crop)], op.dtype), y[crop], seen[crop]
    if seen.all():
        return False

    def squares(model: SceneModel, *iterations: int) -> Iterator[float]:
        for error in _prediction_errors(model.reduce(part), y, seen, noise, denoiser, *iterations):
            yield float(np.mean(error[~seen] ** 2)) - noise**2

    of_simple = next(squares(simple, ITERATIONS))
    # below 0 all is noise, and tells nothing; the other model only gets better after the early look
    return all(square > 0 and of_simple <= CLEARLY * square for square in squares(other, EARLY, ITERATIONS))


def _prediction_errors(
    op: SensingOperator, y: np.ndarray, seen: np.ndarray, noise: float, denoiser: Denoiser, *iterations: int
) -> Iterator[np.ndarray]:
    """y - Phi x (H, W) for x estimated from the pixels of y that are seen, after so many iterations each."""
    partial = SensingOperator(op.masks * seen.astype(op.masks.dtype), op.dtype)
    for state in iterate(partial, y * seen, denoiser, level(op, y * seen), noise=noise):
        if state.iteration in iterations:
            yield y - op.forward(state.x)
        if state.iteration == iterations[-1]:
            return


def _worst_tile(error: np.ndarray) -> tuple[slice, slice]:
    """The tile of TILE x TILE pixels (or the whole of a smaller side) with the largest sum of errors."""
    rows, columns = (min(TILE, n) for n in error.shape)
    tops, lefts = (range(0, n - t + 1, max(t // 2, 1)) for n, t in zip(error.shape, (rows, columns)))
    top, left = max(
        itertools.product(tops, lefts), key=lambda c: error[c[0] : c[0] + rows, c[1] : c[1] + columns].sum()
    )
    return slice(top, top + rows), slice(left, left + columns)
