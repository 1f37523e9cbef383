"""What a scene requires, from its measurement alone: which views hold anything, and whether anything moves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from pnp_sci.plugins.protocols import Denoiser
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.solvers.iterate import iterate

DARK = 0.08  # of the brightest view's level: below, a view may be absent
TILE = 96  # pixels a side of the crop on which models are compared
WINDOW = 48  # pixels a side of what lies in its middle: something small that moves in a still scene is to be found
HELD_BACK = 0.1  # of the pixels of y, to be predicted
LEAST, PER_FRAME = 60, 3  # iterations of the quick estimates; with fewer the full model has not shown what it can do
# Iterations on all of the picture, that show where the simple model is worst off: before careful estimates, and before
# quick ones, where fewer find as much. Before careful ones a dim view that moves would be lost with them.
LOOK, GLANCE = 15, 8
EARLY = 20  # ... and mostly that the full one is better
EVERYWHERE = 0.3  # of the mean squared error, added to that of every window: where both models fit well is no contest
# Of the full model's squared error beyond the noise, after 20 iterations with TV and more; still scenes have at most
# 1.1 on 11 clips of 128 x 128 and 256 x 256 through masks for two views of ten frames and for one of eight.
PERHAPS = 1.2
# ... in the end. On 14 such clips of 256 x 256 still ones have at most 0.87, all but 3 of 28 moving ones 0.85 or more.
CLEARLY = 0.8
# ... where flow takes over from TV half way, after so many calls of it, in parts of all: on 11 clips of each of these
# kinds still ones have at most 1.4 after 12 of 60 and moving ones 1.8 or more, with noise of 0.01 and 0.02 of max(y)
# too. Later they overlap; but by then what moves in a picture that is hard to explain may have come forth.
CAREFULLY, CALLS = 1.6, (8 / 60, 12 / 60, 20 / 60)
# ... for a dark view, and with TV for a view that stands still beside moving ones, whose errors both models share. With
# flow the mean gain must then be so many standard errors in the end: of 15 still views 8 have that, of moving ones
# hardly any but those that move little or are dim. One is enough for all 15, but for some that lose 1 to 6 dB, too.
NO_WORSE, SURELY = 1.0, 2.0
# Largest evidence, in standard errors, for what the full model shows and the simple one cannot: changes along time, or
# a view. What is hidden has no part in the estimates, so that it is chance where the simple model is right: 5 % of 120
# still scenes (clips of the training, views of equal and of unequal brightness, with noise and without) have more than
# 2.5 at any look of flow on the tile, and of 120 moving ones three in four more than 4.
CHANCE = 3.0
SATURATED = 0.01  # of the pixels of y: with more it is no chance which ones are left, and evidence misleads
# Of the variance of the noise, which may be estimated so much too low: left in both errors, that makes them alike.
DOUBT = 0.1

Make = Callable[[], Denoiser]
# Whether the squared errors (N,) of a simple model, beyond the noise, are fine beside another's
IsFine = Callable[[np.ndarray, np.ndarray], bool]


def patience(op: SensingOperator) -> int:
    """Iterations of quick estimates: three for each frame of all views, 60 at least. Careful ones begin with half."""
    return max(LEAST, PER_FRAME * op.shape[0] * op.shape[1])


def judge(
    problem: Problem, quick: Make, careful: Make | None = None, each_view: bool = False, until: float = np.inf
) -> SceneModel:
    """What this measurement requires to be modelled, from the measurement alone.

    Simpler models are tried against the full one: without the views whose level is near 0, and with one frame per view.
    A tenth of the pixels of y is held back, both models are estimated quickly from the rest, and where the simple one
    is worst off beside the other they are compared with more care: it is taken if it predicts what was held back
    clearly better there too, or with a `careful` denoiser not much worse, and if what the full model shows beyond it
    explains nothing of its errors but by chance.

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
    until : float
        A moment of ``time.perf_counter``: a model that has not shown by then that it is better is not taken.
    """
    op = problem.op
    predicts_better = _Comparison(problem, until, LOOK if careful else GLANCE)
    chosen = full(op, "every view and frame is needed")
    half, calls = patience(op) // 2, [round(part * patience(op)) for part in CALLS]
    clearly = {patience(op): partial(_at_most, CLEARLY)}
    no_worse = {half: partial(_at_most, NO_WORSE), half + calls[0]: partial(_at_most, NO_WORSE)}
    levels = view_levels(op, problem.y)
    lit = tuple(bool(v) for v in levels > DARK * levels.max())
    if not all(lit) and any(lit):
        dark = ", ".join(str(v + 1) for v, on in enumerate(lit) if not on)
        without = SceneModel(lit, False, f"view {dark} is dark: y is explained without it")
        with_care = careful if predicts_better.by_chance else None
        if predicts_better(without, chosen, with_care or quick, no_worse if with_care else clearly):
            chosen = without
    if op.shape[1] == 1:
        return chosen
    so_far = "" if chosen.complete else chosen.reason + "; "
    still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
    if careful is None:
        looks = {EARLY: partial(_at_most, PERHAPS)} | clearly
        return still if predicts_better(still, chosen, quick, looks) else chosen
    by_tv = dict.fromkeys((EARLY, half), partial(_at_most, PERHAPS))
    by_flow = {half + n: partial(_at_most, CAREFULLY) for n in calls[:-1]} | {half + calls[-1]: _whatever}
    if predicts_better(still, chosen, careful, by_tv | by_flow, DOUBT):
        return still
    beside = dict.fromkeys((EARLY, half), partial(_at_most, NO_WORSE)) | {half + calls[-1]: _beyond_chance}
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

    def __init__(self, problem: Problem, until: float, look: int):
        self.problem, self.until, self.look = problem, until, look
        self.hidden = np.random.default_rng(0).random(problem.y.shape) < HELD_BACK
        self.seen = ~self.hidden
        # which pixels are left to be hidden, but for a few
        self.by_chance = problem.saturated is None or problem.saturated.mean() < SATURATED
        if problem.saturated is not None:
            self.hidden, self.seen = self.hidden & ~problem.saturated, self.seen & ~problem.saturated
        self._known: dict[SceneModel, tuple[np.ndarray, np.ndarray]] = {}

    def __call__(
        self, simple: SceneModel, other: SceneModel, make: Make, looks: dict[int, IsFine], doubt: float = 0
    ) -> bool:
        """Whether the simple model predicts well enough, on the tile where it is worst off, at each of the looks.

        A look is a number of iterations, and what has to hold after it; and always that nothing speaks for what the
        other model shows beyond the simple one.
        """
        op, y = self.problem.op, self.problem.y
        if time.perf_counter() > self.until:
            return False
        errors, (others, x) = self._first(simple, make)[0], self._first(other, make)
        if self.by_chance and _evidence(errors, _beyond(simple, other, op, x), self.hidden) > CHANCE:
            return False
        crop = _contested_tile(*(self.hidden * e**2 for e in (errors, others)))
        part = SensingOperator(op.masks[(..., *crop)], op.dtype)
        y, hidden, seen = (picture[crop] for picture in (y, self.hidden, self.seen))
        if not hidden.any():
            return False
        expected = self.problem.typical_noise**2 * (1 + doubt)

        def estimates(model: SceneModel) -> Iterator[tuple[np.ndarray, np.ndarray]]:
            return _predictions(model.reduce(part), y, seen, self.problem.typical_noise, make(), *looks)

        for is_fine, (errors, _), (others, x) in zip(looks.values(), estimates(simple), estimates(other)):
            squares = (e[hidden].astype(np.float64) ** 2 - expected for e in (errors, others))
            if not is_fine(*squares) or time.perf_counter() > self.until:
                return False
            if self.by_chance and _evidence(errors, _beyond(simple, other, part, x), hidden) > CHANCE:
                return False
        return True

    def _first(self, model: SceneModel, make: Make) -> tuple[np.ndarray, np.ndarray]:
        """Early errors (H, W) and estimates of the whole picture."""
        if model not in self._known:
            op, y, noise = model.reduce(self.problem.op), self.problem.y, self.problem.typical_noise
            self._known[model] = next(_predictions(op, y, self.seen, noise, make(), self.look))
        return self._known[model]


def _at_most(share: float, simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the squared errors of the simple model are such a share of the other's, which are no mere noise."""
    return bool(other.mean() > 0 and simple.mean() <= share * other.mean())


def _whatever(simple: np.ndarray, other: np.ndarray) -> bool:
    """Where errors are not compared."""
    return True


def _beyond_chance(simple: np.ndarray, other: np.ndarray) -> bool:
    """Whether the simple model predicts better, beyond chance, where the errors of the other are no mere noise."""
    gain = other - simple
    return bool(other.mean() > 0 and gain.mean() >= SURELY * gain.std() / np.sqrt(gain.size) > 0)


def _beyond(simple: SceneModel, other: SceneModel, op: SensingOperator, x: np.ndarray) -> np.ndarray:
    """What each view of y (V, H, W) has from an estimate x of the other model that the simple one cannot show.

    Freed of what it would have through masks of their mean everywhere, which errors may follow without any chance.
    """
    video = other.expand(x, op.shape)
    beyond = video - simple.expand(simple.restrict(video), op.shape)
    even = np.einsum("vb,vbhw->vhw", op.masks.mean((2, 3), dtype=np.float64), beyond)
    return np.einsum("vbhw,vbhw->vhw", op.masks, beyond) - even


def _evidence(errors: np.ndarray, shown: np.ndarray, hidden: np.ndarray) -> float:
    """How much speaks for any of what is `shown` (V, H, W), as part of the errors (H, W) of what is hidden.

    In standard errors of least squares, if nothing of it is in the errors, which may be larger in some places than in
    others (the score test with White's variance). At most the root of the number of pixels that it shows in: what moves
    in a few of the hidden ones has no voice.
    """
    errors, shown = errors[hidden].astype(np.float64), shown[:, hidden].astype(np.float64)
    shown = shown[shown.any(1)]
    normal = np.linalg.pinv(np.einsum("vp,wp->vw", shown, shown), hermitian=True)
    parts = normal @ np.einsum("vp,p->v", shown, errors)
    weighed = shown * errors
    variance = np.diagonal(normal @ np.einsum("vp,wp->vw", weighed, weighed) @ normal)
    return float(np.max(parts / np.sqrt(np.maximum(variance, np.finfo(np.float64).tiny)), initial=0))


def _predictions(
    op: SensingOperator, y: np.ndarray, seen: np.ndarray, noise: float, denoiser: Denoiser, *iterations: int
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """y - Phi x (H, W) and x, estimated from the pixels of y that are seen, after so many iterations each."""
    sampled = SensingOperator(op.masks * seen.astype(op.masks.dtype), op.dtype)
    for state in iterate(sampled, y * seen, denoiser, level(op, y * seen), noise=noise):
        if state.iteration in iterations:
            yield y - op.forward(state.x), state.x
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
