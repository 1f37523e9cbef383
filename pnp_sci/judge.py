"""What a scene requires, from its measurement alone: which views hold anything, and whether anything moves."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from .loop import iterate
from .operator import SensingOperator
from .problem import Problem, level
from .protocols import Denoiser
from .scene import SceneModel, full

DARK = 0.08  # of the brightest view's level: below, a view may be absent
TILE = 96  # pixels a side of the crop on which models are compared
WINDOW = 48  # pixels a side of what lies in its middle: something small that moves in a still scene is to be found
HELD_BACK = 0.1  # of the pixels of y, to be predicted
LEAST, PER_FRAME = 60, 3  # iterations of the quick estimates; with fewer the full model has not shown what it can do
LOOK = 10  # iterations that show where the simple model is worst off
EARLY = 20  # ... and mostly that the full one is better
EVERYWHERE = 0.3  # of the mean squared error, added to that of every window: where both models fit well is no contest
# Of the full model's squared error beyond the noise, after 20 iterations with TV and more; still scenes have at most
# 1.1 on 11 clips of 128 x 128 and 256 x 256 through masks for two views of ten frames and for one of eight.
PERHAPS = 1.2
# ... in the end. On 14 such clips of 256 x 256 still ones have at most 0.87, all but 3 of 28 moving ones 0.85 or more.
CLEARLY = 0.8
# ... where flow takes over from TV half way, after so many calls of it, in parts of all: on 11 clips of each of these
# kinds still ones have at most 1.4 after 12 of 60 and moving ones 1.8 or more, with noise of 0.01 and 0.02 of max(y)
# too. After 30 calls they overlap.
CAREFULLY, CALLS = 1.6, (8 / 60, 12 / 60)
# ... with TV for a view that stands still beside moving ones, whose errors both models share. With flow the mean gain
# must then be a standard error in the end: on 11 pairs of clips of 128 x 128 with a still view 8 have that, and none of
# 66 views of pairs that move. (Chosen on these pairs.)
BESIDE, SURELY = 1.0, 1.0
# Of the variance of the noise, which may be estimated so much too low: left in both errors, that makes them alike.
DOUBT = 0.1

Make = Callable[[], Denoiser]
# Whether the squared errors (N,) of a simple model, beyond the noise, are fine beside another's.
IsFine = Callable[[np.ndarray, np.ndarray], bool]


def patience(op: SensingOperator) -> int:
    """Iterations of quick estimates: three for each frame of all views, 60 at least. Careful ones begin with half."""
    return max(LEAST, PER_FRAME * op.shape[0] * op.shape[1])


def judge(problem: Problem, quick: Make, careful: Make | None = None, each_view: bool = False) -> SceneModel:
    """What this measurement requires to be modelled, from the measurement alone.

    Simpler models are tried against the full one: without the views whose level is near 0, and with one frame per view.
    A tenth of the pixels of y is held back, both models are estimated quickly from the rest, and where the simple one
    is worst off beside the other they are compared with more care: it is taken if it predicts what was held back
    clearly better there too, or with a `careful` denoiser not much worse.

    Parameters
    ----------
    problem : Problem
    quick : callable
        Makes a denoiser for quick estimates, such as TV.
    careful : callable, optional
        Makes a better one, such as flow, for solvers whose prior is better than the quick one too. Its first calls,
        half of :func:`patience`, are those of the quick one. Where masks are sparse, frames many or pictures small, a
        still model is as good as what TV makes of a moving scene, but not as good as what flow makes of it.
    each_view : bool
        Whether single views that stand still beside others are looked for, with the careful denoiser. All models share
        the errors of what moves there, so that one frame must predict better, and beyond chance.
    """
    op = problem.op
    predicts_better = _Comparison(problem)
    chosen = full(op, "every view and frame is needed")
    clearly = {patience(op): partial(_at_most, CLEARLY)}
    levels = view_levels(op, problem.y)
    lit = tuple(bool(v) for v in levels > DARK * levels.max())
    if not all(lit) and any(lit):
        dark = ", ".join(str(v + 1) for v, on in enumerate(lit) if not on)
        without = SceneModel(lit, False, f"view {dark} is dark: y is explained without it")
        if predicts_better(without, chosen, quick, clearly):
            chosen = without
    if op.shape[1] == 1:
        return chosen
    so_far = "" if chosen.complete else chosen.reason + "; "
    still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
    if careful is None:
        looks = {EARLY: partial(_at_most, PERHAPS)} | clearly
        return still if predicts_better(still, chosen, quick, looks) else chosen
    half, calls = patience(op) // 2, [round(part * patience(op)) for part in CALLS]
    by_tv = dict.fromkeys((EARLY, half), partial(_at_most, PERHAPS))
    by_flow = {half + n: partial(_at_most, CAREFULLY) for n in calls}
    if predicts_better(still, chosen, careful, by_tv | by_flow, DOUBT):
        return still
    beside = dict.fromkeys((EARLY, half), partial(_at_most, BESIDE)) | {half + calls[-1]: _beyond_chance}
    for view in np.flatnonzero(chosen.views) if each_view else ():
        stills = tuple(s or v == view for v, s in enumerate(chosen.still))  # type: ignore[arg-type]
        names = " and ".join(str(v + 1) for v, s in enumerate(stills) if s)
        model = SceneModel(chosen.views, stills, f"{so_far}one frame explains what y shows of view {names}")
        if not model.nothing_moves and predicts_better(model, chosen, careful, beside, DOUBT):
            chosen = model
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


class _Comparison:
    """Models of a scene, compared by how they predict pixels of y that are held back; saturated ones are left out."""

    def __init__(self, problem: Problem):
        self.problem = problem
        self.hidden = np.random.default_rng(0).random(problem.y.shape) < HELD_BACK
        self.seen = ~self.hidden
        if problem.saturated is not None:
            self.hidden, self.seen = self.hidden & ~problem.saturated, self.seen & ~problem.saturated
        self._first: dict[SceneModel, np.ndarray] = {}

    def __call__(
        self, simple: SceneModel, other: SceneModel, make: Make, looks: dict[int, IsFine], doubt: float = 0
    ) -> bool:
        """Whether the simple model predicts well enough, on the tile where it is worst off, at each of the looks.

        A look is a number of iterations, and what has to hold after it.
        """
        crop = _contested_tile(*(self._first_errors(model, make) for model in (simple, other)))
        op, y = self.problem.op, self.problem.y[crop]
        hidden, seen = self.hidden[crop], self.seen[crop]
        if not hidden.any():
            return False
        part = SensingOperator(op.masks[(..., *crop)], op.dtype)
        expected = self.problem.typical_noise**2 * (1 + doubt)

        def squares(model: SceneModel) -> Iterator[np.ndarray]:
            for error in _prediction_errors(model.reduce(part), y, seen, self.problem.typical_noise, make(), *looks):
                yield error[hidden].astype(np.float64) ** 2 - expected

        return all(is_fine(s, o) for is_fine, s, o in zip(looks.values(), squares(simple), squares(other)))

    def _first_errors(self, model: SceneModel, make: Make) -> np.ndarray:
        """The squared errors (H, W) of early estimates of all that is held back, 0 elsewhere."""
        if model not in self._first:
            op, y, noise = model.reduce(self.problem.op), self.problem.y, self.problem.typical_noise
            error = next(_prediction_errors(op, y, self.seen, noise, make(), LOOK))
            self._first[model] = self.hidden * error**2
        return self._first[model]


def _at_most(share: float, simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the squared errors of the simple model are such a share of the other's, which are no mere noise."""
    return bool(other.mean() > 0 and simple.mean() <= share * other.mean())


def _beyond_chance(simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the simple model predicts better, beyond chance, where the errors of the other are no mere noise."""
    gain = other - simple
    return bool(other.mean() > 0 and gain.mean() >= SURELY * gain.std() / np.sqrt(gain.size) > 0)


def _prediction_errors(
    op: SensingOperator, y: np.ndarray, seen: np.ndarray, noise: float, denoiser: Denoiser, *iterations: int
) -> Iterator[np.ndarray]:
    """y - Phi x (H, W) for x estimated from the pixels of y that are seen, after so many iterations each."""
    sampled = SensingOperator(op.masks * seen.astype(op.masks.dtype), op.dtype)
    for state in iterate(sampled, y * seen, denoiser, level(op, y * seen), noise=noise):
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
