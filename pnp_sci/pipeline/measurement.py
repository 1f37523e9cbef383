"""One measurement from start to end: scene, first estimate, plan, iterations, and what is made of the last estimate."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.pipeline.blend import blended
from pnp_sci.pipeline.progress import Watch
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import Request
from pnp_sci.pipeline.start import first_estimate
from pnp_sci.plugins.combine import InTurn
from pnp_sci.results.history import Record, Status
from pnp_sci.scene.choose import choose_scene
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.solvers.iterate import ALGORITHMS, states
from pnp_sci.solvers.pace import in_time, remember
from pnp_sci.solvers.plan import make_plan
from pnp_sci.solvers.run import run
from pnp_sci.solvers.state import State, length, start
from pnp_sci.solvers.stopping import relative_residual

JUDGING = 0.25  # of a time budget, to find out what of a scene has to be modelled


@dataclass(frozen=True, eq=False)
class Outcome:
    """What has become of a measurement: its video is in the array that :func:`reconstruct` was given.

    Attributes
    ----------
    problem : Problem
    status : Status
    records : list of Record
    scene : dict
        What was found of the scene.
    plan : dict or None
        See :meth:`pnp_sci.solvers.plan.Plan.describe`; None if a callback had stopped before.
    start : str
        The first estimate.
    shares : list of float
        What a decoder's estimate counts in each view that was modelled.
    weights : list of str
        Hashes of the weights of networks.
    """

    problem: Problem
    status: Status
    records: list[Record]
    scene: dict[str, Any]
    plan: dict[str, Any] | None
    start: str
    shares: list[float]
    weights: list[str]
    model: SceneModel | None = None


def reconstruct(
    problem: Problem,
    request: Request,
    out: np.ndarray,
    *,
    deadline: float | None = None,
    watch: Watch,
    truth: Reference | None = None,
    n: int = 0,
) -> Outcome:
    """Solve a measurement, the n-th; the video goes to `out` (V, B, H, W), in the user's units."""
    op, traits = problem.op, request.prior.traits(problem.op.shape)
    scene = choose_scene(request.scene, problem, traits.strong, traits.strong, _judged_until(deadline))
    reduced, described = scene.reduce(op), scene.describe(op)
    start = first_estimate(request.init, problem, scene, traits.network, request.device, deadline)
    name, decoded, x = start.name, start.decoded, scene.restrict(start.x)
    described["remarks"] += start.remarks
    del start  # the first estimate is freed after the first step, but for a decoder's
    plan = make_plan(
        reduced, problem.noise, request.prior,
        algorithm=request.algorithm, effort=request.counted,
        iterations=request.iterations, sigma=request.sigma, tol=request.tol, deadline=deadline,
    )  # fmt: skip
    plan = in_time(plan, reduced, problem.y, traits, decoded)
    watch.expect(plan.iterations)
    session = InTurn(plan.serves, reduced.shape, reduced.dtype)

    def score(x: np.ndarray) -> float | None:
        return truth.psnr(scene.expand(x, op.shape), n, problem.unit) if truth else None

    finish = _Finish(problem, reduced, session, x if decoded else None)
    iterates = states(reduced, problem.y, session, x, ALGORITHMS[plan.algorithm], plan.schedule, problem.saturated)
    del x
    state, status, records = run(
        iterates,
        problem.y,
        plan,
        watch,
        noise=problem.typical_noise,
        score=score,
        saturated=problem.saturated,
        finish=finish,
    )
    remember(plan, reduced.shape, [record.seconds for record in records], finish.seconds)
    put(scene.expand(state.x, op.shape), out, problem.unit)
    facts = session.facts()
    described["at_rest"] = scene.at_rest(facts.get("still", []))
    records = [replace(record, measurement=n) for record in records]
    if truth and records:
        records[-1] = replace(records[-1], ssim=truth.ssim(out, n))
    found = described | counts(problem)
    found["remarks"] += truth.remarks(out, n) if truth else []
    weights = list(facts.get("weights", []))
    return Outcome(problem, status, records, found, plan.describe(), name, finish.shares, weights, scene)


class _Finish:
    """Makes of a last estimate what prior and decoder can: the prior's finish, then the decoder's share."""

    def __init__(self, problem: Problem, op: SensingOperator, session: InTurn, decoded: np.ndarray | None):
        self.problem, self.op, self.session, self.decoded = problem, op, session, decoded
        self.shares, self.seconds = [0.0] * op.shape[0], 0.0

    def __call__(self, state: State) -> State:
        begin = time.perf_counter()
        x = self.session.finish(state.x, state.sigma)
        x = shaped("what the prior's finish returns", x, state.x.shape, state.x.dtype)
        if self.decoded is not None:
            x, self.shares = blended(self.problem, x, self.decoded)
        residual = self.problem.y - self.op.forward(x)
        self.seconds = time.perf_counter() - begin
        return replace(state, x=x, residual=residual)


def untouched(problem: Problem, out: np.ndarray, n: int, truth: Reference | None = None) -> Outcome:
    """What becomes of the n-th measurement after a callback has stopped: its level, without any iteration."""
    state = start(problem.op, problem.y, level(problem.op, problem.y))
    put(state.x, out, problem.unit)
    residual = relative_residual(state, length(problem.y) or 1.0, problem.saturated)
    psnr, ssim = (truth.psnr(state.x, n, problem.unit), truth.ssim(out, n)) if truth else (None, None)
    record = Record(0, 0.0, residual, float("nan"), psnr, ssim, n)
    scene = full(problem.op, "not judged: the callback had stopped the solver").describe(problem.op)
    found = scene | {"at_rest": [None] * problem.op.shape[0]} | counts(problem)
    return Outcome(problem, Status.STOPPED, [record], found, None, "adjoint", [], [])


def put(x: np.ndarray, video: np.ndarray, unit: float) -> None:
    """video <- x * unit, as far as the type reaches; 0 where x is not finite."""
    if not np.isfinite(x).all():
        video[:] = 0
        return
    with np.errstate(over="ignore"):  # an estimate may be larger than what y and the masks allow
        np.multiply(x, video.dtype.type(unit), out=video)
    np.nan_to_num(video, copy=False)


def _judged_until(deadline: float | None) -> float:
    now = time.perf_counter()
    return np.inf if deadline is None else now + JUDGING * (deadline - now)


def counts(problem: Problem) -> dict[str, Any]:
    """Pixels of y that are saturated, those that are bad, and the others that every mask leaves closed."""
    saturated, bad = (0 if pixels is None else int(pixels.sum()) for pixels in (problem.saturated, problem.bad))
    return {"saturated": saturated, "bad": bad, "closed": int((problem.op.gram == 0).sum()) - bad}


def package_settings(request: Request, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The settings of a result that say how it was obtained."""
    solved = [outcome for outcome in outcomes if outcome.plan]
    starts, plans = {outcome.start for outcome in solved}, [outcome.plan for outcome in solved]
    return request.settings() | {
        "weights": next((outcome.weights for outcome in outcomes if outcome.weights), []),
        "init": starts.pop() if len(starts) == 1 else "auto",
        "share": [outcome.shares for outcome in outcomes],
        "iterations": max((plan["iterations"] for plan in plans if plan), default=0),
        "plan": plans,
    }
