"""All measurements, one after the other or consecutive ones together, and the result that they make."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pnp_sci._validate import positive_number
from pnp_sci.accel.threads import limited
from pnp_sci.camera.fit import Fit
from pnp_sci.errors import InputError
from pnp_sci.pipeline.input import Input
from pnp_sci.pipeline.measurement import Outcome, judged_until, package_settings, untouched
from pnp_sci.pipeline.noise_of_still import noise_of_still
from pnp_sci.pipeline.progress import Watch, watching
from pnp_sci.pipeline.provenance import provenance
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import Request, check_request
from pnp_sci.pipeline.sequence import Window, alike, scene_of_all, windows
from pnp_sci.pipeline.tiles import reconstruct_in_tiles
from pnp_sci.pipeline.unit import in_unit_of_scene
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.sensing.sensor import Sensor

_log = logging.getLogger("pnp_sci")


def solve_all(y: Any, masks: Any, reference: Any, peak: float | None, options: dict[str, Any]) -> Result:
    """What :func:`pnp_sci.solve` does; `options` are all its other arguments."""
    began = time.perf_counter()
    given = Input.of(y, masks, options.pop("bad"), options.pop("mosaic"))
    options["init"] = given.modelled(options["init"])
    op, count, several = given.op, len(given.measurements), np.ndim(y) == 3
    request = check_request(op, count, **options, mosaic=given.mosaic)
    if (options["sequence"] is True or request.sequence > 1) and not several:
        raise InputError(f"sequence is {options['sequence']}, but y has shape {np.shape(y)}: (N, H, W) was expected")
    peak = None if peak is None else positive_number("peak", peak)
    colours = () if given.mosaic is None else (3,)
    truth = None if reference is None else Reference(reference, (count, *op.shape, *colours), peak, given.shown)
    remarks = _of_options(request)

    videos = np.empty((count, *op.shape), op.dtype)
    outcomes: list[Outcome] = []
    errors = np.full(videos.shape, np.nan, op.dtype) if request.uncertainty else None
    with limited(request.threads), watching(options["callback"], options["progress"]) as watch:
        given, sensor = given.registered(request.register, request.sensor, masks)
        fits = given.check(sensor)
        for scene, window, problems in _posed(given, request, sensor, fits, began, watch):
            kept = slice(window.kept.start, window.kept.stop)
            end = _share_of_time(began, request.time_budget, len(window.kept), count - window.kept.start)
            deadline = _middle(end) if request.uncertainty else end
            if watch.stopped:
                outcomes.append(untouched(window.of_kept(problems), videos[kept], window.kept, truth))
                continue
            seen = {"window": window, "watch": watch, "truth": truth}
            outcomes.append(reconstruct_in_tiles(problems, request, scene, videos[kept], deadline=deadline, **seen))
            if errors is not None and not watch.stopped:
                predict_errors(request, scene, outcomes[-1], problems, window, videos[kept], errors[kept], end)
    began += truth.seconds if truth else 0.0  # the metrics are not the solver's time
    problems = [problem for outcome in outcomes for problem in outcome.problems]
    scenes = [scene for outcome in outcomes for scene in outcome.scenes]
    videos = given.shown(videos)
    return Result(
        videos if several else videos[0],
        Status.worst([outcome.status for outcome in outcomes]),
        History(record for outcome in outcomes for record in outcome.records),
        package_settings(request, outcomes) | provenance(y, masks, given.largest, problems, began),
        [given.found(scene, fit, remarks) for scene, fit in zip(scenes, fits)],
        errors if errors is None or several else errors[0],
    )


def _of_options(request: Request) -> list[str]:
    """What to know of the options before a result is used; it is logged, too."""
    if request.sigma is None or request.sigma <= 1:
        return []
    text = f"sigma is {request.sigma:g}, but it is in units where x spans about [0, 1]"
    _log.warning(told := f"{text}: if these are grey levels of 255, give {request.sigma / 255:.2g}")
    return [told]


def _posed(
    given: Input, request: Request, sensor: Sensor, fits: list[Fit], began: float, watch: Watch
) -> Iterator[tuple[SceneModel, Window, Sequence[Problem]]]:
    """What is modelled, and the problems that are solved together, window by window."""
    count, strong = len(given.measurements), request.prior.traits(given.op.shape).strong

    def judged(problems: Sequence[Problem], deadline: float | None) -> tuple[SceneModel, Sequence[Problem]]:
        """The model, found in the unit that y alone shows, and the problems in the unit of the scene."""
        if strong:
            problems = [problem.steady() for problem in problems]
        scene = scene_of_all(request.scene, problems, judged_until(deadline), careful=strong, each_view=strong)
        return scene, in_unit_of_scene(problems, judged_until(deadline)) if strong else problems

    if request.sequence == 1:
        for n, problem in enumerate(given.problems(sensor, fits)):
            window = Window(range(n, n + 1), range(n, n + 1))
            if watch.stopped:
                yield full(problem.op), window, [problem]
                continue
            scene, problems = judged([problem], _share_of_time(began, request.time_budget, 1, count - n))
            yield scene, window, problems
        return
    problems = alike(list(given.problems(sensor, fits)), sensor.read_noise == "auto")
    end = None if request.time_budget is None else began + request.time_budget
    scene, problems = judged(problems, end)
    problems = noise_of_still(problems, scene, request, judged_until(end))
    for window in windows(count, request.sequence):
        yield scene, window, problems[window.seen.start : window.seen.stop]


def predict_errors(
    request: Request,
    scene: SceneModel,
    outcome: Outcome,
    problems: Sequence[Problem],
    window: Window,
    videos: np.ndarray,
    errors: np.ndarray,
    deadline: float | None,
) -> None:
    """errors <- the predicted errors of videos, by a second solve; a remark where they cannot be said."""
    from pnp_sci.pipeline.uncertainty import held_back, uncertainty, without_pixels

    hidden = [held_back(problem) for problem in problems]
    second = np.full_like(videos, np.nan)
    if outcome.status.ok and all(pixels is not None for pixels in hidden):
        init = request.init if isinstance(request.init, str) else "adjoint"  # a video knows the hidden pixels
        same = replace(request, init=init)
        noise = outcome.problems[0].noise
        told = [replace(p, noise=noise, estimated=False) if p.estimated else p for p in problems]
        others = [without_pixels(*pair) for pair in zip(told, hidden)]  # type: ignore[arg-type]
        again = reconstruct_in_tiles(others, same, scene, second, window=window, deadline=deadline, watch=Watch(None))
        if not again.status.ok:
            second.fill(np.nan)
    for k, (problem, pixels) in enumerate(zip(outcome.problems, window.of_kept(hidden))):
        unit = np.asarray(problem.unit, videos.dtype)
        found = uncertainty(problem, pixels, videos[k] / unit, second[k] / unit)  # type: ignore[arg-type]
        if found is None:
            text = "uncertainty: unknown, as one of two solves failed or too few pixels can be held back"
            outcome.scenes[k]["remarks"].append(text)
        else:
            np.multiply(found, problem.unit, out=errors[k], casting="unsafe")


def _middle(end: float | None) -> float | None:
    """The moment halfway from now to the end."""
    return None if end is None else (time.perf_counter() + end) / 2


def _share_of_time(began: float, budget: float | None, due: int, left: int) -> float | None:
    """The moment by which those that are due, of so many measurements that are left, must be done."""
    now = time.perf_counter()
    return None if budget is None else now + (began + budget - now) * due / left
