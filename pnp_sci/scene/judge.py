"""What a scene requires, from its measurement alone: which views hold anything, and whether anything moves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from pnp_sci._tuned import Tuned
from pnp_sci.plugins.protocols import Prior
from pnp_sci.scene.dark_views import lit_views, view_levels
from pnp_sci.scene.evidence import TUNED as TILES
from pnp_sci.scene.evidence import always, at_most, beyond, beyond_chance, contested_tile, evidence
from pnp_sci.scene.movers import shows_more
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.solvers.iterate import iterate

# Whether the squared errors (N,) of a simple model, beyond the noise, are fine beside another's
IsFine = Callable[[np.ndarray, np.ndarray], bool]

HELD_BACK = 0.1  # part of the pixels of y that is predicted
CHANCE = 3.0  # standard errors: evidence against the simple model up to that may be chance
DIM = 0.4  # level of a view, in units of the brightest one's, below which errors of others hide its motion
NO_WORSE = 1.0  # ratio of errors up to which a model without a view, or with one still view, is taken


@dataclass(frozen=True)
class SceneNumbers(Tuned):
    """When a simpler model is taken; ratios are of its squared error to that of the full one, beyond the noise."""

    least: int = 60  # iterations of a quick estimate, at least
    per_frame: int = 3  # iterations of a quick estimate for each frame of all views
    perhaps: float = 1.2  # largest ratio, early; its inverse at the end of quick estimates
    carefully: float = 1.6  # largest ratio of careful estimates
    doubt: float = 0.1  # part of the variance of the noise by which its estimate may be too low


TUNED = SceneNumbers()


@dataclass(frozen=True)
class _Trial:
    """What a simple model has to pass.

    Attributes
    ----------
    prior : Prior
        Of the estimates.
    looks : dict
        Numbers of iterations, and the condition on the squared errors after each.
    doubt : float
        Part of the variance of the noise by which its estimate may be too low.
    """

    prior: Prior
    looks: dict[int, IsFine]
    doubt: float = 0.0


def patience(op: SensingOperator) -> int:
    """Iterations of a quick estimate: three for each frame of all views, 60 at least."""
    return max(TUNED.least, TUNED.per_frame * op.shape[0] * op.shape[1])


def judge(
    problem: Problem, quick: Prior, careful: Prior | None = None, each_view: bool = False, until: float = np.inf
) -> SceneModel:
    """What this measurement requires to be modelled, from the measurement alone.

    Simpler models are tried against the full one: without the views whose level is near 0, and with one frame per view.
    A tenth of the pixels of y is held back, and both models are estimated from the rest. They are compared on the tile
    where the simple model predicts the held-back pixels worst, relative to the full one. The simple model is taken if
    it predicts clearly better there, or with a `careful` prior not much worse. Besides, what only the full
    model shows, motion or a view, must not correlate with the errors of the simple one, at last in a larger crop as
    well, and nowhere in the picture may the simple model's residual follow masks that it does not use, see
    :mod:`pnp_sci.scene.movers`.

    Parameters
    ----------
    problem : Problem
    quick : Prior
        For quick estimates, such as TV.
    careful : Prior, optional
        A better one, such as flow, for solvers with a strong prior. Its warm-up takes half of :func:`patience`. With
        sparse masks, many frames or small pictures, TV does not tell a still scene from a moving one, but flow does.
    each_view : bool
        Whether single views that stand still beside moving ones are looked for, with the careful prior. All models
        share the errors of the moving view: one frame must predict better by 1.645 standard errors. Views that are less
        than 0.4 as bright as the brightest one are not tried: errors of that one hide whether they move.
    until : float
        A moment of ``time.perf_counter``: a model that has not shown by then that it is better is not taken.
    """
    op, last = problem.op, patience(problem.op)
    early, half, soon, later = last // 3, last // 2, last // 2 + last // 5, last // 2 + last // 3  # iterations of looks
    clearly, no_worse, perhaps, carefully = (
        partial(at_most, ratio) for ratio in (1 / TUNED.perhaps, NO_WORSE, TUNED.perhaps, TUNED.carefully)
    )
    passes = _Comparison(problem, quick, until, last // (4 if careful else 8))
    of_dark = _Trial(quick, {last: clearly})
    if careful is None:
        of_still = _Trial(quick, {early: perhaps, last: clearly})
    else:
        if passes.by_chance:
            of_dark = _Trial(careful, {half: no_worse, soon: no_worse})
        of_still = _Trial(careful, {early: perhaps, half: perhaps, soon: carefully, later: always}, TUNED.doubt)
    chosen = full(op, "every view and frame is needed")
    lit = lit_views(op, problem.y)
    if not all(lit) and any(lit):
        dark = ", ".join(str(v + 1) for v, on in enumerate(lit) if not on)
        without = SceneModel(lit, False, f"view {dark} is dark: y is explained without it")
        if passes(without, chosen, of_dark):
            chosen = without
    if op.shape[1] == 1:
        return chosen
    so_far = "" if chosen.complete else chosen.reason + "; "
    still = SceneModel(chosen.views, True, so_far + "nothing moves: one frame per view explains y")
    if passes(still, chosen, of_still):
        return still
    if careful is None or not each_view:
        return chosen
    of_view = _Trial(careful, {early: no_worse, half: no_worse, later: beyond_chance}, TUNED.doubt)
    levels = view_levels(op, problem.y)
    for view in np.flatnonzero(np.array(chosen.views) & (levels >= DIM * levels.max())):
        stills = tuple(s or v == view for v, s in enumerate(chosen.still))  # type: ignore[arg-type]
        names = " and ".join(str(v + 1) for v, s in enumerate(stills) if s)
        model = SceneModel(chosen.views, stills, f"{so_far}one frame explains what y shows of view {names}")
        if not model.nothing_moves and passes(model, chosen, of_view):
            chosen = model
    return chosen


@dataclass(frozen=True, eq=False)
class _Pixels:
    """A picture y (H, W): models are estimated from the pixels that are seen, and predict the hidden ones.

    `until` is the moment after which estimates raise a TimeoutError.
    """

    op: SensingOperator
    y: np.ndarray
    seen: np.ndarray
    hidden: np.ndarray
    noise: float
    until: float

    def crop(self, where: tuple[slice, slice]) -> _Pixels:
        """The same of a part of the picture."""
        y, seen, hidden = (picture[where] for picture in (self.y, self.seen, self.hidden))
        return replace(self, op=self.op.crop(where), y=y, seen=seen, hidden=hidden)

    def estimates(self, model: SceneModel, prior: Prior, *iterations: int) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Errors y - Phi x (H, W) and x of the seen pixels, after so many iterations each."""
        op, y = model.reduce(self.op), self.y * self.seen
        sampled = SensingOperator(op.masks * self.seen.astype(op.masks.dtype), op.dtype)
        for state in iterate(sampled, y, prior, level(op, y), noise=self.noise):
            if time.perf_counter() > self.until:
                raise TimeoutError
            if state.iteration in iterations:
                yield self.y - op.forward(state.x), state.x
            if state.iteration == iterations[-1]:
                return

    def evidence(self, simple: SceneModel, other: SceneModel, errors: np.ndarray, x: np.ndarray) -> float:
        """What of errors of the simple model the other one shows in its x, in standard errors."""
        return evidence(errors, beyond(simple, other, self.op, x), self.hidden)


class _Comparison:
    """Models of a scene, compared by how they predict pixels of y that are held back; saturated ones are left out."""

    def __init__(self, problem: Problem, quick: Prior, until: float, look: int):
        self.quick, self.look = quick, look
        held_back, usable = np.random.default_rng(0).random(problem.y.shape) < HELD_BACK, problem.usable
        # if fewer pixels are saturated than held back, the held-back ones are still a random choice
        self.by_chance = problem.saturated is None or problem.saturated.mean() < HELD_BACK
        seen, hidden = usable & ~held_back, usable & held_back
        self.pixels = _Pixels(problem.op, problem.y, seen, hidden, problem.typical_noise, until)
        self._known: dict[SceneModel, tuple[np.ndarray, np.ndarray]] = {}

    def __call__(self, simple: SceneModel, other: SceneModel, trial: _Trial) -> bool:
        """Whether the simple model passes the trial; false where there is no time to find out."""
        if time.perf_counter() > self.pixels.until:
            return False
        try:
            return self._passes(simple, other, trial) and time.perf_counter() <= self.pixels.until
        except TimeoutError:
            return False

    def _passes(self, simple: SceneModel, other: SceneModel, trial: _Trial) -> bool:
        """Whether the simple model predicts well enough on its worst tile, and nothing around speaks against it."""
        errors, (others, x) = self._first(simple, trial.prior)[0], self._first(other, trial.prior)
        if self.by_chance and self.pixels.evidence(simple, other, errors, x) > CHANCE:
            return False
        of_simple, of_other = (self.pixels.hidden * e**2 for e in (errors, others))
        tile, around = (contested_tile(of_simple, of_other, side) for side in (TILES.tile, TILES.tile * 4 // 3))
        if not self._holds(simple, other, trial, tile) or self._leaves_a_mover(simple, trial.prior):
            return False
        if tile == around or not self.by_chance:  # the tile is the picture, or there is no evidence
            return True
        return self._holds(simple, other, replace(trial, looks={max(trial.looks): always}), around)

    def _holds(self, simple: SceneModel, other: SceneModel, trial: _Trial, crop: tuple[slice, slice]) -> bool:
        """Whether the conditions on the errors hold on a crop, and nothing there is evidence of the other model."""
        pixels = self.pixels.crop(crop)
        if not pixels.hidden.any():
            return False
        expected = pixels.noise**2 * (1 + trial.doubt)
        of_simple, of_other = (pixels.estimates(model, trial.prior, *trial.looks) for model in (simple, other))
        for is_fine, (errors, _), (others, x) in zip(trial.looks.values(), of_simple, of_other):
            squares = (e[pixels.hidden].astype(np.float64) ** 2 - expected for e in (errors, others))
            if not is_fine(*squares):
                return False
            if self.by_chance and pixels.evidence(simple, other, errors, x) > CHANCE:
                return False
        return True

    def _leaves_a_mover(self, simple: SceneModel, prior: Prior) -> bool:
        """Whether the residual of a smooth estimate shows what the simple model cannot.

        What the first estimate has not predicted is noise to the smooth one, so that it does not fit what passes.
        """
        op, known = self.pixels.op, self.pixels.seen | self.pixels.hidden
        unexplained = self._first(simple, prior)[0][self.pixels.hidden].astype(np.float64)
        noise = float(np.sqrt(np.mean(unexplained**2)))
        enough = patience(op) if simple.nothing_moves else self.look
        residual, _ = next(replace(self.pixels, seen=known, noise=noise).estimates(simple, self.quick, enough))
        return shows_more(simple, op, residual * known)

    def _first(self, model: SceneModel, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
        """Early errors (H, W) and estimates of the whole picture."""
        if model not in self._known:
            self._known[model] = next(self.pixels.estimates(model, prior, self.look))
        return self._known[model]
