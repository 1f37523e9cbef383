"""Measurements from start to end, alone or several as one video: first estimate, plan, iterations, finish."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from pnp_sci.accel.arrays import like
from pnp_sci.pipeline.blend import blended
from pnp_sci.pipeline.noise_of_still import noise_of_still
from pnp_sci.pipeline.progress import Watch
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import Request
from pnp_sci.pipeline.sequence import Window, together
from pnp_sci.pipeline.start import first_estimate, may_decode
from pnp_sci.pipeline.unseen import Unseen
from pnp_sci.plugins.combine import InTurn
from pnp_sci.results.history import Record, Status
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.sensing.sequence import joined, split
from pnp_sci.solvers.iterate import ALGORITHMS, states
from pnp_sci.solvers.pace import in_time, remember
from pnp_sci.solvers.plan import Plan, make_plan
from pnp_sci.solvers.run import run
from pnp_sci.solvers.state import Array, Operator, State, length, start
from pnp_sci.solvers.stopping import explains, held, noise_floor, relative_residual

LITTLE = 1.5  # times the residual of noise: a measurement of noise alone has nothing that could be explained
UNEXPLAINED = "the video explains nothing of y: the relative residual is {:.2f}, where that of a black video is 1; {}"
OF_THE_PRIOR = "test the prior with pnp_sci.testing.check_prior"
OF_THE_MASKS = "the masks are all 0"
NO_TIME = (
    "x is the first estimate, as no iteration could be finished within the time budget: first calls in a process also "
    "load and compile code; call solve again, or give more time"
)
JUDGING = 0.25  # of a time budget, to find out what of a scene has to be modelled


@dataclass(frozen=True, eq=False)
class Outcome:
    """What has become of a measurement, or of consecutive ones that were solved together.

    Their videos are in the array that :func:`reconstruct` was given.

    Attributes
    ----------
    problems : list of Problem
        Of each measurement.
    status : Status
    records : list of Record
    scenes : list of dict
        What was found of the scene of each measurement.
    plan : dict or None
        See :meth:`pnp_sci.solvers.plan.Plan.describe`; None if a callback had stopped before.
    start : str
        The first estimate.
    shares : list of float
        What a decoder's estimate counts in each view that was modelled.
    weights : list of str
        Hashes of the weights of networks.
    """

    problems: list[Problem]
    status: Status
    records: list[Record]
    scenes: list[dict[str, Any]]
    plan: dict[str, Any] | None
    start: str
    shares: list[float]
    weights: list[str]


def reconstruct(
    problems: Sequence[Problem],
    request: Request,
    scene: SceneModel,
    out: np.ndarray,
    *,
    window: Window,
    deadline: float | None = None,
    watch: Watch,
    truth: Reference | None = None,
) -> Outcome:
    """Solve the measurements that a window sees, as one video.

    The videos of those that are kept go to `out` (N, V, B, H, W), in the user's units.
    """
    op, backend = problems[0].op, request.backend
    traits = request.prior.traits(op.shape)
    problems = noise_of_still(problems, scene, request, judged_until(deadline))
    kept_problems = window.of_kept(problems)
    joint = together(problems)
    modelled = scene.reduce(joint.op)
    x, name, decoded, remarks = _first(problems, request, window, scene, may_decode(traits, deadline), deadline)
    plan = _plan(request, modelled, joint, decoded, deadline)
    unseen = Unseen(joint, modelled, plan, traits.strong and request.sigma is None, backend)
    watch.expect(plan.iterations)

    def videos(x: Array) -> list[np.ndarray]:
        return [scene.expand(video, op.shape) for video in window.of_kept(split(backend.get(x), len(problems)))]

    def psnr(x: Array) -> float:
        of_each = zip(videos(x), window.kept, kept_problems)
        return float(np.mean([truth.psnr(video, n, problem.unit) for video, n, problem in of_each]))  # type: ignore[union-attr]

    with backend.running():
        session = InTurn(plan.serves, modelled.shape, modelled.dtype, backend.device)
        phi, y, x, saturated = backend.operator(modelled), *map(backend.put, (joint.y, x, joint.saturated))
        schedule = replace(plan.schedule, product=backend.put(plan.schedule.product))
        finish = _Finish(joint, phi, y, session, x if decoded else None)
        iterates = states(phi, y, session, x, ALGORITHMS[plan.algorithm], schedule, saturated, unseen)
        del x  # freed after the first step, but for a decoder's
        state, status, records = run(
            iterates, y, unseen.during(plan), watch,
            noise=joint.typical_noise, most=held(modelled, joint.y), score=psnr if truth else None,
            saturated=saturated, finish=finish,
        )  # fmt: skip
        remember(plan, modelled.shape, [record.seconds for record in records], finish.seconds, backend)
        for video, own, problem in zip(videos(state.x), out, kept_problems):
            put(video, own, problem.unit)
        facts = session.facts()
    solved = [unseen.of(problem) for problem in kept_problems]
    remarks = remarks + _of_the_end(joint, status, records)
    scenes = [found(scene, problem, facts.get("still", []), remarks) for problem in solved]
    records = [replace(record, measurement=window.kept.start) for record in records]
    if truth and records:
        _compare(truth, window.kept, out, records, scenes)
    weights = list(facts.get("weights", []))
    return Outcome(solved, status, records, scenes, unseen.describe(plan), name, finish.shares, weights)


def _first(
    problems: Sequence[Problem],
    request: Request,
    window: Window,
    scene: SceneModel,
    decode: bool,
    deadline: float | None,
) -> tuple[np.ndarray, str, bool, list[str]]:
    """The first estimate of the modelled part of all measurements: x, its name, whether it is decoded, and remarks."""
    first = [
        first_estimate(request.init_of(n), problem, scene, decode, request.device, deadline)
        for n, problem in zip(window.seen, problems)
    ]
    x = joined([scene.restrict(start.x) for start in first])
    remarks = next((start.remarks for start in first if start.remarks), [])
    return x, one_or_auto(start.name for start in first), all(start.decoded for start in first), remarks


def _plan(request: Request, op: SensingOperator, problem: Problem, decoded: bool, deadline: float | None) -> Plan:
    """The plan for what is modelled of a problem, by its operator; with the pace of its priors if time is limited."""
    plan = make_plan(
        op, problem.noise, request.prior,
        algorithm=request.algorithm, effort=request.counted,
        iterations=request.iterations, sigma=request.sigma, tol=request.tol, decoded=decoded, deadline=deadline,
    )  # fmt: skip
    return in_time(plan, op, problem.y, request.backend)


def found(
    scene: SceneModel, problem: Problem, still: Sequence[float] = (), remarks: Sequence[str] = ()
) -> dict[str, Any]:
    """What was found of the scene of a measurement; `still` are the parts of the modelled views that are at rest."""
    entry = scene.describe(problem.op) | {"at_rest": scene.at_rest(still)} | entries(problem)
    return entry | {"remarks": [*entry["remarks"], *remarks]}


def one_or_auto(names: Iterable[str]) -> str:
    """The name of the first estimates if all have the same, else "auto"."""
    different = set(names)
    return different.pop() if len(different) == 1 else "auto"


def _compare(
    truth: Reference, kept: range, videos: np.ndarray, records: list[Record], scenes: list[dict[str, Any]]
) -> None:
    """Add SSIM to the last record, and remarks on the truth to the scenes."""
    records[-1] = replace(records[-1], ssim=float(np.mean([truth.ssim(v, n) for n, v in zip(kept, videos)])))
    for found, n, video in zip(scenes, kept, videos):
        found["remarks"] += truth.remarks(video, n)


def _of_the_end(problem: Problem, status: Status, records: Sequence[Record]) -> list[str]:
    """The remark on a video that explains nothing of y, though no failure was found, or for which there was no time."""
    if status is Status.TIME_BUDGET and records[-1].iteration == 0:
        return [NO_TIME]
    floor = LITTLE * noise_floor(problem.typical_noise, problem.y)
    if status not in (Status.CONVERGED, Status.ITERATIONS) or explains(records[-1].residual, floor):
        return []
    cause = OF_THE_PRIOR if problem.op.gram.any() else OF_THE_MASKS
    return [UNEXPLAINED.format(records[-1].residual, cause)]


class _Finish:
    """Makes of a last estimate what prior and decoder can: the prior's finish, then the decoder's share."""

    def __init__(self, problem: Problem, op: Operator, y: Array, session: InTurn, decoded: Array | None):
        self.problem, self.op, self.y, self.session, self.decoded = problem, op, y, session, decoded
        self.shares, self.seconds = [0.0] * op.shape[0], 0.0

    def __call__(self, state: State) -> State:
        begin = time.perf_counter()
        x = self.session.finish(state.x, state.sigma)
        x = like("what the prior's finish returns", x, state.x)
        if self.decoded is not None:
            x, self.shares = blended(self.problem, x, self.decoded)
        residual = self.y - self.op.forward(x)
        length(residual)  # which waits for a device
        self.seconds = time.perf_counter() - begin
        return replace(state, x=x, residual=residual)


def untouched(problems: Sequence[Problem], out: np.ndarray, kept: range, truth: Reference | None = None) -> Outcome:
    """What becomes of measurements after a callback has stopped: their level, without any iteration."""
    records, scenes = [], []
    for problem, video, n in zip(problems, out, kept):
        state = start(problem.op, problem.y, level(problem.op, problem.y))
        put(state.x, video, problem.unit)
        residual = relative_residual(state, length(problem.y) or 1.0, problem.saturated)
        psnr, ssim = (truth.psnr(state.x, n, problem.unit), truth.ssim(video, n)) if truth else (None, None)
        records.append(Record(0, 0.0, residual, float("nan"), psnr, ssim, n))
        scenes.append(found(full(problem.op, "not judged: the callback had stopped the solver"), problem))
    return Outcome(list(problems), Status.STOPPED, records, scenes, None, "adjoint", [], [])


def put(x: np.ndarray, video: np.ndarray, unit: float | np.ndarray) -> None:
    """video <- x * unit, as far as the type reaches; 0 where x is not finite."""
    if not np.isfinite(x).all():
        video[:] = 0
        return
    with np.errstate(over="ignore"):  # an estimate may be larger than what y and the masks allow
        np.multiply(x, np.asarray(unit, video.dtype), out=video)
    np.nan_to_num(video, copy=False)


def judged_until(deadline: float | None) -> float:
    """The moment until which the scene may be judged, to meet a deadline."""
    now = time.perf_counter()
    return np.inf if deadline is None else now + JUDGING * (deadline - now)


def entries(problem: Problem) -> dict[str, Any]:
    """What `Result.scene` says of a measurement: pixels of y that are saturated, bad, and closed; the light."""
    saturated, bad = (0 if pixels is None else int(pixels.sum()) for pixels in (problem.saturated, problem.bad))
    light = None if problem.light is None else problem.light[..., 0, 0].round(3).tolist()
    return {"saturated": saturated, "bad": bad, "closed": int((problem.op.gram == 0).sum()) - bad, "light": light}


def package_settings(request: Request, outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The settings of a result that say how it was obtained."""
    solved = [outcome for outcome in outcomes if outcome.plan]
    plans = [outcome.plan for outcome in solved]
    return request.settings() | {
        "weights": next((outcome.weights for outcome in outcomes if outcome.weights), []),
        "init": one_or_auto(outcome.start for outcome in solved),
        "share": [outcome.shares for outcome in outcomes],
        "iterations": max((plan["iterations"] for plan in plans if plan), default=0),
        "plan": plans,
        "statuses": [outcome.status.name for outcome in outcomes],
    }
