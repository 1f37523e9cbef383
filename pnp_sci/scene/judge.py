"""What a scene requires, from its measurement alone: which views hold anything, and whether anything moves."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

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
    op = problem.op
    predicts_better = _Comparison(problem, quick, until, patience(op) // (4 if careful else 8))
    chosen = full(op, "every view and frame is needed")
    last = patience(op)
    early, half, soon, later = last // 3, last // 2, last // 2 + last // 5, last // 2 + last // 3  # iterations of looks
    clearly = {last: partial(at_most, 1 / TUNED.perhaps)}
    no_worse = dict.fromkeys((half, soon), partial(at_most, NO_WORSE))
    lit = lit_views(op, problem.y)
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
        looks = {early: partial(at_most, TUNED.perhaps)} | clearly
        return still if predicts_better(still, chosen, quick, looks) else chosen
    by_tv = dict.fromkeys((early, half), partial(at_most, TUNED.perhaps))
    by_flow = {soon: partial(at_most, TUNED.carefully), later: always}
    if predicts_better(still, chosen, careful, by_tv | by_flow, TUNED.doubt):
        return still
    beside = dict.fromkeys((early, half), partial(at_most, NO_WORSE)) | {later: beyond_chance}
    levels = view_levels(op, problem.y)
    for view in np.flatnonzero(np.array(chosen.views) & (levels >= DIM * levels.max())) if each_view else ():
        stills = tuple(s or v == view for v, s in enumerate(chosen.still))  # type: ignore[arg-type]
        names = " and ".join(str(v + 1) for v, s in enumerate(stills) if s)
        model = SceneModel(chosen.views, stills, f"{so_far}one frame explains what y shows of view {names}")
        if not model.nothing_moves and predicts_better(model, chosen, careful, beside, TUNED.doubt):
            chosen = model
    return chosen


class _Comparison:
    """Models of a scene, compared by how they predict pixels of y that are held back; saturated ones are left out."""

    def __init__(self, problem: Problem, quick: Prior, until: float, look: int):
        self.problem, self.quick, self.until, self.look = problem, quick, until, look
        self.hidden = np.random.default_rng(0).random(problem.y.shape) < HELD_BACK
        self.seen = ~self.hidden
        # if fewer pixels are saturated than held back, the held-back ones are still a random choice
        self.by_chance = problem.saturated is None or problem.saturated.mean() < HELD_BACK
        for unknown in (problem.saturated, problem.bad):
            if unknown is not None:
                self.hidden, self.seen = self.hidden & ~unknown, self.seen & ~unknown
        self._known: dict[SceneModel, tuple[np.ndarray, np.ndarray]] = {}

    def __call__(self, *comparison: Any) -> bool:
        """As :meth:`_predicts_better`; false where there is no time to find out."""
        try:
            return self._predicts_better(*comparison)
        except TimeoutError:
            return False

    def _predicts_better(
        self, simple: SceneModel, other: SceneModel, prior: Prior, looks: dict[int, IsFine], doubt: float = 0
    ) -> bool:
        """Whether the simple model predicts well enough on its worst tile, and nothing around speaks against it.

        A look is a number of iterations and a condition on the squared errors after it.
        """
        op = self.problem.op
        if time.perf_counter() > self.until:
            return False
        errors, (others, x) = self._first(simple, prior)[0], self._first(other, prior)
        if self.by_chance and evidence(errors, beyond(simple, other, op, x), self.hidden) > CHANCE:
            return False
        of_simple, of_other = (self.hidden * e**2 for e in (errors, others))
        tile, around = (contested_tile(of_simple, of_other, side) for side in (TILES.tile, TILES.tile * 4 // 3))
        if not self._holds(simple, other, prior, looks, doubt, tile) or self._leaves_a_mover(simple, prior):
            return False
        if tile == around or not self.by_chance:  # the tile is the picture, or there is no evidence
            return time.perf_counter() < self.until
        return self._holds(simple, other, prior, {max(looks): always}, doubt, around)

    def _holds(
        self,
        simple: SceneModel,
        other: SceneModel,
        prior: Prior,
        looks: dict[int, IsFine],
        doubt: float,
        crop: tuple[slice, slice],
    ) -> bool:
        """Whether the conditions on the errors hold on a crop, and nothing there is evidence of the other model."""
        part = self.problem.op.crop(crop)
        y, hidden, seen = (picture[crop] for picture in (self.problem.y, self.hidden, self.seen))
        if not hidden.any():
            return False
        expected = self.problem.typical_noise**2 * (1 + doubt)

        def estimates(model: SceneModel) -> Iterator[tuple[np.ndarray, np.ndarray]]:
            noise = self.problem.typical_noise
            return _predictions(model.reduce(part), y, seen, noise, prior, *looks, until=self.until)

        for is_fine, (errors, _), (others, x) in zip(looks.values(), estimates(simple), estimates(other)):
            squares = (e[hidden].astype(np.float64) ** 2 - expected for e in (errors, others))
            if not is_fine(*squares) or time.perf_counter() > self.until:
                return False
            if self.by_chance and evidence(errors, beyond(simple, other, part, x), hidden) > CHANCE:
                return False
        return True

    def _leaves_a_mover(self, simple: SceneModel, prior: Prior) -> bool:
        """Whether the residual of a smooth estimate shows what the simple model cannot.

        What the first estimate has not predicted is noise to the smooth one, so that it does not fit what passes.
        """
        op, y, known = simple.reduce(self.problem.op), self.problem.y, self.seen | self.hidden
        unexplained = self._first(simple, prior)[0][self.hidden].astype(np.float64)
        noise = float(np.sqrt(np.mean(unexplained**2)))
        enough = patience(self.problem.op) if simple.nothing_moves else self.look
        residual = next(_predictions(op, y, known, noise, self.quick, enough))[0]
        return shows_more(simple, self.problem.op, residual * known)

    def _first(self, model: SceneModel, prior: Prior) -> tuple[np.ndarray, np.ndarray]:
        """Early errors (H, W) and estimates of the whole picture; TimeoutError after `until`."""
        if model not in self._known:
            op, y, noise = model.reduce(self.problem.op), self.problem.y, self.problem.typical_noise
            self._known[model] = next(_predictions(op, y, self.seen, noise, prior, self.look, until=self.until))
        return self._known[model]


def _predictions(
    op: SensingOperator,
    y: np.ndarray,
    seen: np.ndarray,
    noise: float,
    prior: Prior,
    *iterations: int,
    until: float = np.inf,
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """y - Phi x (H, W) and x, estimated from the pixels of y that are seen, after so many iterations each.

    Raises a TimeoutError after the moment `until`.
    """
    sampled = SensingOperator(op.masks * seen.astype(op.masks.dtype), op.dtype)
    for state in iterate(sampled, y * seen, prior, level(op, y * seen), noise=noise):
        if state.iteration in iterations:
            yield y - op.forward(state.x), state.x
        if state.iteration == iterations[-1]:
            return
        if time.perf_counter() > until:
            raise TimeoutError
