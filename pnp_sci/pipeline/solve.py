"""All measurements, one after the other, and the result that they make."""

from __future__ import annotations

import logging
import time
from dataclasses import replace
from typing import Any

import numpy as np

from pnp_sci._validate import positive_number
from pnp_sci.accel.threads import limited
from pnp_sci.masks import views_are_separable
from pnp_sci.pipeline.input import Input
from pnp_sci.pipeline.measurement import Outcome, package_settings, reconstruct, untouched
from pnp_sci.pipeline.progress import Watch, watching
from pnp_sci.pipeline.provenance import provenance
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import Request, check_request
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem

_log = logging.getLogger("pnp_sci")


def solve_all(y: Any, masks: Any, reference: Any, peak: float | None, options: dict[str, Any]) -> Result:
    """What :func:`pnp_sci.solve` does; `options` are all its other arguments."""
    began = time.perf_counter()
    given = Input.of(y, masks, options.pop("bad"))
    op, measurements = given.op, given.measurements
    request = check_request(op, len(measurements), **options)
    peak = None if peak is None else positive_number("peak", peak)
    truth = Reference(reference, (len(measurements), *op.shape), peak) if reference is not None else None
    _warn_of_lost_views(op)

    videos = np.empty((len(measurements), *op.shape), op.dtype)
    outcomes: list[Outcome] = []
    errors = np.full(videos.shape, np.nan, op.dtype) if request.uncertainty else None
    with limited(request.threads), watching(options["callback"], options["progress"]) as watch:
        given, sensor = given.registered(request.register, request.sensor, masks)
        fits = given.check(sensor)
        for n, problem in enumerate(given.problems(sensor, fits)):
            end = _share_of_time(began, request.time_budget, len(measurements) - n)
            deadline = _middle(end) if request.uncertainty else end
            outcomes.append(
                untouched(problem, videos[n], n, truth)
                if watch.stopped
                else reconstruct(problem, request, videos[n], deadline=deadline, watch=watch, truth=truth, n=n)
            )
            if errors is not None and not watch.stopped:
                predict_errors(request, outcomes[-1], videos[n], errors[n], end)
    began += truth.seconds if truth else 0.0  # the metrics are not the solver's time
    problems = [outcome.problem for outcome in outcomes]
    return Result(
        videos if np.ndim(y) == 3 else videos[0],
        Status.worst([outcome.status for outcome in outcomes]),
        History(record for outcome in outcomes for record in outcome.records),
        package_settings(request, outcomes) | provenance(y, masks, given.largest, problems, began),
        [given.found(outcome.scene, fit) for outcome, fit in zip(outcomes, fits)],
        errors if errors is None or np.ndim(y) == 3 else errors[0],
    )


def predict_errors(
    request: Request, outcome: Outcome, video: np.ndarray, errors: np.ndarray, deadline: float | None
) -> None:
    """errors <- the predicted errors of a video, by a second solve; a remark where they cannot be said."""
    from pnp_sci.pipeline.uncertainty import uncertainty

    init = request.init if isinstance(request.init, str) else "auto"  # a video knows the pixels that are held back
    same = replace(request, scene=outcome.model or request.scene, init=init)

    def again(problem: Problem) -> np.ndarray:
        out = np.empty(op.shape, op.dtype)
        reconstruct(problem, same, out, deadline=deadline, watch=Watch(None))
        return out / op.dtype.type(problem.unit)

    problem, op = outcome.problem, outcome.problem.op
    found = None
    if outcome.status.ok and outcome.model is not None:
        found = uncertainty(problem, video / op.dtype.type(problem.unit), again)
    if found is None:
        outcome.scene["remarks"].append("uncertainty: unknown, as the solve failed or too few pixels can be held back")
    else:
        np.multiply(found, problem.unit, out=errors, casting="unsafe")


def _middle(end: float | None) -> float | None:
    """The moment halfway from now to the end."""
    return None if end is None else (time.perf_counter() + end) / 2


def _share_of_time(began: float, budget: float | None, left: int) -> float | None:
    """The moment by which the next of so many measurements that are left must be done."""
    now = time.perf_counter()
    return None if budget is None else now + (began + budget - now) / left


def _warn_of_lost_views(op: SensingOperator) -> None:
    """Log what the masks make impossible; the solver goes on all the same."""
    if not op.masks.any():
        _log.warning("masks are all 0: nothing is measured, and the first estimate is as good as any")
    elif not views_are_separable(op.masks):
        _log.warning(
            "masks of the views are too much alike, or those of one are all 0: the views cannot be told apart; "
            "see pnp_sci.condition(masks)"
        )
