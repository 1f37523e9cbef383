"""What a scene requires: which views hold anything, and whether anything moves."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from .errors import InputError, InputTypeError
from .loop import iterate
from .operator import SensingOperator
from .problem import Problem, level
from .protocols import Denoiser

DARK = 0.08  # of the brightest view's level: below, a view may be absent
TILE = 96  # pixels a side of the crop on which models are compared
WINDOW = 48  # pixels a side of what lies in its middle: something small that moves in a still scene is to be found
HELD_BACK = 0.1  # of the pixels of y, to be predicted
ITERATIONS = 60  # of the quick estimates; with fewer the full model has not shown yet what it can do
LOOK = 10  # iterations that show where the simple model is worst off
EARLY = 20  # ... and sometimes that the full one is better
EVERYWHERE = 0.3  # of the mean squared error, added to that of every window: where both models fit well is no contest
# Of the full model's squared error beyond the noise. On 14 clips of 256 x 256 through masks for two views of ten frames
# and for one of eight, still ones have at most 0.87 of it and all but 3 of 28 moving ones 0.85 or more.
CLEARLY = 0.8
# ... where a careful comparison follows: on 11 such clips still ones have at most 1.12 of it, but for one of 44. There,
# with flow in the place of TV, still ones have at most 1.4 but for four of one view, moving ones 1.7 but for one clip.
PERHAPS, CAREFULLY = 1.2, 1.4
# Of the variance of the noise, which may be estimated so much too low: left in both errors, that makes them alike.
DOUBT = 0.1


@dataclass(frozen=True)
class SceneModel:
    """What is modelled of a scene.

    Attributes
    ----------
    views : tuple of bool
        Which views hold anything; the others come out as 0.
    still : bool or tuple of bool
        Whether one frame of a view stands for all of them; one answer for all views, or one for each. Kept as a tuple.
    reason : str
        In words.
    """

    views: tuple[bool, ...]
    still: bool | tuple[bool, ...] = False
    reason: str = "as asked for"

    def __post_init__(self):
        views = _bools("views", self.views, "a tuple of bool")  # 0 and 1 would be indices
        still = self.still
        still = (
            (bool(still),) * len(views)
            if isinstance(still, (bool, np.bool_))
            else _bools("still", still, "True, False or a tuple of bool")
        )
        if len(still) != len(views):
            raise InputError(f"still has {len(still)} values: {len(views)} were expected, one for each view")
        object.__setattr__(self, "views", views)
        object.__setattr__(self, "still", still)

    @property
    def complete(self) -> bool:
        """Whether every view and frame is modelled; then nothing is copied."""
        return all(self.views) and not self._still_of_lit.any()

    @property
    def nothing_moves(self) -> bool:
        """Whether all views that hold anything stand still."""
        return bool(self._still_of_lit.all())

    @property
    def _still_of_lit(self) -> np.ndarray:
        """Which of the views that hold anything stand still."""
        return np.array(self.still)[np.array(self.views)]

    def reduce(self, op: SensingOperator) -> SensingOperator:
        """The operator of what is modelled: masks of the views there are, summed over time if nothing moves.

        A view that stands still beside another that moves has the mean of its masks for each of its frames: they then
        measure the same and stay the same.
        """
        if self.complete:
            return op
        masks = op.masks[np.array(self.views)]
        if self.nothing_moves:
            masks = masks.sum(1, keepdims=True, dtype=op.dtype)
        elif self._still_of_lit.any():
            masks = masks.astype(op.dtype)
            masks[self._still_of_lit] = masks[self._still_of_lit].mean(1, keepdims=True)
        return SensingOperator(masks, op.dtype)

    def restrict(self, x: np.ndarray) -> np.ndarray:
        """Of a video (V, B, H, W), what is modelled."""
        if self.complete:
            return x
        kept = x[np.array(self.views)]
        kept[self._still_of_lit] = kept[self._still_of_lit].mean(1, keepdims=True)
        return kept[:, :1] if self.nothing_moves else kept

    def expand(self, x: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """The video (V, B, H, W) of what was modelled."""
        if self.complete:
            return x
        full = np.zeros(shape, x.dtype)
        full[np.array(self.views)] = x
        if not self.nothing_moves:
            still = np.array(self.still) & np.array(self.views)
            full[still] = full[still].mean(1, keepdims=True)
        return full

    def describe(self, op: SensingOperator) -> dict[str, Any]:
        """For `Result.scene`."""
        views, frames = op.shape[:2]
        modelled = sum(1 if still else frames for still in self._still_of_lit)
        alike = self.nothing_moves or not self._still_of_lit.any()
        still = self.nothing_moves if alike else self.still
        return asdict(self) | {"still": still, "frames_modelled": modelled, "frames": views * frames}


def _bools(name: str, values: Any, expected: str) -> tuple[bool, ...]:
    try:
        return tuple(bool(value) for value in values)
    except (TypeError, ValueError) as error:
        raise InputTypeError(f"{name} is {values!r}: {expected} was expected") from error


def full(op: SensingOperator, reason: str = "as asked for") -> SceneModel:
    """Everything is modelled."""
    return SceneModel((True,) * op.shape[0], False, reason)


def judge(problem: Problem, denoiser: Denoiser, careful: Denoiser | None = None) -> SceneModel:
    """What this measurement requires to be modelled, from the measurement alone.

    Simpler models are tried against the full one: without the views whose level is near 0, and with one frame per view.
    A tenth of the pixels of y is held back, both models are estimated quickly from the rest, and where the simple one
    is worst off beside the other they are compared with more care: it is taken if it predicts what was held back
    clearly better there too, or with a `careful` denoiser hardly worse.

    Parameters
    ----------
    problem : Problem
    denoiser : Denoiser
        For the quick estimates, such as TV.
    careful : Denoiser, optional
        A better one, such as flow, for solvers whose prior is better than `denoiser` too: with it both models are
        compared once more. Where masks are sparse, frames many or pictures small, a still model is as good as what TV
        makes of a moving scene, but not as good as what flow makes of it.
    """
    op = problem.op
    chosen = full(op, "every view and frame is needed")
    levels = view_levels(op, problem.y)
    lit = tuple(bool(v) for v in levels > DARK * levels.max())
    if not all(lit) and any(lit):
        dark = ", ".join(str(v + 1) for v, on in enumerate(lit) if not on)
        without = SceneModel(lit, False, f"view {dark} is dark: y is explained without it")
        if _predicts_better(problem, denoiser, without, chosen):
            chosen = without
    if op.shape[1] > 1:
        so_far = "" if chosen.complete else chosen.reason + "; "
        still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
        if _predicts_better(problem, denoiser, still, chosen, careful):
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
    problem: Problem, denoiser: Denoiser, simple: SceneModel, other: SceneModel, careful: Denoiser | None = None
) -> bool:
    """Whether the simple model predicts pixels of y held back well enough, on the tile where it is worst off.

    That is clearly better than the other one; with a careful denoiser, hardly worse with either. Saturated pixels are
    neither seen nor predicted.
    """
    op, y, noise = problem.op, problem.y, problem.typical_noise
    expected = noise**2 * (1 if careful is None else 1 + DOUBT)
    hidden = np.random.default_rng(0).random(y.shape) < HELD_BACK
    seen = ~hidden
    if problem.saturated is not None:
        hidden, seen = hidden & ~problem.saturated, seen & ~problem.saturated
    errors = (next(_prediction_errors(model.reduce(op), y, seen, noise, denoiser, LOOK)) for model in (simple, other))
    crop = _contested_tile(*(hidden * error**2 for error in errors))
    part, y, hidden, seen = SensingOperator(op.masks[(..., *crop)], op.dtype), y[crop], hidden[crop], seen[crop]
    if not hidden.any():
        return False

    def squares(model: SceneModel, prior: Denoiser, *iterations: int) -> Iterator[float]:
        for error in _prediction_errors(model.reduce(part), y, seen, noise, prior, *iterations):
            yield float(np.mean(error[hidden] ** 2)) - expected

    of_simple = next(squares(simple, denoiser, ITERATIONS))
    share = CLEARLY if careful is None else PERHAPS
    # below 0 all is noise, and tells nothing; the other model only gets better after the early look
    if not all(square > 0 and of_simple <= share * square for square in squares(other, denoiser, EARLY, ITERATIONS)):
        return False
    if careful is None:
        return True
    return next(squares(simple, careful, ITERATIONS)) <= CAREFULLY * next(squares(other, careful, ITERATIONS))


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


def _contested_tile(simple: np.ndarray, other: np.ndarray) -> tuple[slice, slice]:
    """The tile around the window where a model's squared errors (H, W) are largest beside those of another one.

    Where they are largest in themselves it is fine texture that they show, which may well stand still.
    """
    from scipy.ndimage import uniform_filter

    window = tuple(min(WINDOW, n) for n in simple.shape)
    inside = tuple(slice(w // 2, n - (w - 1) // 2) for n, w in zip(simple.shape, window))
    of_simple, of_other = (
        uniform_filter(errors, window, np.float64)[inside] + EVERYWHERE * errors.mean()  # type: ignore[arg-type]
        for errors in (simple, other)
    )
    ratio = of_simple / np.maximum(of_other, np.finfo(np.float64).tiny)
    middle = np.unravel_index(np.argmax(ratio), ratio.shape)
    return tuple(_around(int(m) + i.start, n) for m, i, n in zip(middle, inside, simple.shape))  # type: ignore[return-value]


def _around(middle: int, length: int) -> slice:
    """TILE pixels around the middle one, within so many; all of them if there are fewer."""
    start = max(min(middle - TILE // 2, length - TILE), 0)
    return slice(start, start + TILE)
