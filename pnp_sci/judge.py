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
EARLY = 20  # ... and sometimes that the full one is better
EVERYWHERE = 0.3  # of the mean squared error, added to that of every window: where both models fit well is no contest
# Of the full model's squared error beyond the noise. On 14 clips of 256 x 256 through masks for two views of ten frames
# and for one of eight, still ones have at most 0.87 of it and all but 3 of 28 moving ones 0.85 or more.
CLEARLY = 0.8
# ... where a careful comparison follows: on 11 such clips still ones have at most 1.12 of it, but for one of 44. There,
# with flow in the place of TV, still ones have at most 1.4 but for four of one view, moving ones 1.7 but for one clip.
PERHAPS, CAREFULLY = 1.2, 1.4
# ... with TV for a view that stands still beside moving ones, whose errors both models share. With flow the mean gain
# must then be so many of its standard errors: on 11 pairs of clips of 128 x 128 with a still view 8 have more, and 4
# with noise of 0.02 of max(y), but of 66 views of pairs that move none. (Chosen on these pairs.)
BESIDE, SURELY = 1.0, 2.0
GLANCE = 2 / 3  # of the iterations: most moving views are found out by then
# Of the variance of the noise, which may be estimated so much too low: left in both errors, that makes them alike.
DOUBT = 0.1

Careful = Callable[[], Denoiser]
# Whether the squared errors (N,) of a simple model, beyond the noise, are fine beside another's.
IsFine = Callable[[np.ndarray, np.ndarray], bool]


def patience(op: SensingOperator) -> int:
    """Iterations of the quick estimates: three for each frame of all views, but 60 at least."""
    return max(LEAST, PER_FRAME * op.shape[0] * op.shape[1])


def judge(problem: Problem, denoiser: Denoiser, careful: Careful | None = None) -> SceneModel:
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
    careful : callable, optional
        Makes a better one, such as flow, for solvers whose prior is better than `denoiser` too: with it both models are
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
        if _predicts_better(problem, without, chosen, (denoiser, partial(_at_most, CLEARLY))):
            chosen = without
    if op.shape[1] > 1:
        so_far = "" if chosen.complete else chosen.reason + "; "
        still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
        if careful is None:
            return still if _predicts_better(problem, still, chosen, (denoiser, partial(_at_most, CLEARLY))) else chosen
        tests = (denoiser, partial(_at_most, PERHAPS)), (careful, {1.0: partial(_at_most, CAREFULLY)})
        if _predicts_better(problem, still, chosen, *tests):
            return still
    return chosen


def with_still_views(problem: Problem, denoiser: Denoiser, careful: Careful, chosen: SceneModel) -> SceneModel:
    """The chosen model of a scene in which something moves, with one frame for each view that stands still in it.

    One view after the other is tried, as :func:`judge` tries models; all share the errors of what moves, so that one
    frame must predict better with the careful denoiser, and beyond chance.
    """
    if chosen.nothing_moves or problem.op.shape[1] == 1:
        return chosen
    looks = {GLANCE: partial(_at_most, 1.0), 1.0: _beyond_chance}
    tests = (denoiser, partial(_at_most, BESIDE)), (careful, looks)
    so_far = "" if chosen.complete else chosen.reason + "; "
    for view in np.flatnonzero(chosen.views):
        still = tuple(s or v == view for v, s in enumerate(chosen.still))  # type: ignore[arg-type]
        names = " and ".join(str(v + 1) for v, s in enumerate(still) if s)
        model = SceneModel(chosen.views, still, f"{so_far}one frame explains what y shows of view {names}")
        if not model.nothing_moves and _predicts_better(problem, model, chosen, *tests):
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


def _predicts_better(
    problem: Problem,
    simple: SceneModel,
    other: SceneModel,
    quick: tuple[Denoiser, IsFine],
    careful: tuple[Careful, dict[float, IsFine]] | None = None,
) -> bool:
    """Whether the simple model predicts pixels of y held back well enough, on the tile where it is worst off.

    That is in each test given, the quick one first, and after each part of the careful one's iterations. Saturated
    pixels are neither seen nor predicted.
    """
    denoiser, is_fine = quick
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

    def squares(model: SceneModel, prior: Denoiser, *iterations: int) -> Iterator[np.ndarray]:
        for error in _prediction_errors(model.reduce(part), y, seen, noise, prior, *iterations):
            yield error[hidden].astype(np.float64) ** 2 - expected

    enough = patience(op)
    of_simple = next(squares(simple, denoiser, enough))
    # below 0 all is noise, and tells nothing; the other model only gets better after the early look
    if not all(o.mean() > 0 and is_fine(of_simple, o) for o in squares(other, denoiser, EARLY, enough)):
        return False
    if careful is None:
        return True
    make, looks = careful
    after = [round(part * enough) for part in looks]
    pairs = zip(looks.values(), squares(simple, make(), *after), squares(other, make(), *after))
    return all(is_fine(s, o) for is_fine, s, o in pairs)


def _at_most(share: float, simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the squared errors of the simple model are such a share of the other's."""
    return bool(simple.mean() <= share * other.mean())


def _beyond_chance(simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the simple model predicts so much better that chance would hardly have it so."""
    gain = other - simple
    return bool(gain.mean() >= SURELY * gain.std() / np.sqrt(gain.size) > 0)


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
