"""From a measurement to videos: ``solve`` with a prior, ``decode`` with a network."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.accel.threads import limited
from pnp_sci.masks import views_are_separable
from pnp_sci.pipeline.measurement import Outcome, package_settings, put, reconstruct, untouched
from pnp_sci.pipeline.progress import watching
from pnp_sci.pipeline.provenance import provenance
from pnp_sci.pipeline.reference import Reference
from pnp_sci.pipeline.request import as_plain, check_request
from pnp_sci.plugins.resolve import as_decoder
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result
from pnp_sci.scene.choose import choose_scene
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, check_measurement, check_noise, check_operator, check_scene, pose
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor, warn_if_saturated
from pnp_sci.solvers.state import State, length

_log = logging.getLogger("pnp_sci")


def solve(
    y: Any,
    masks: Any,
    prior: Any = "tv",
    init: Any = "auto",
    *,
    algorithm: str = "gap",
    effort: str = "balanced",
    scene: str | SceneModel = "auto",
    iterations: int | None = None,
    noise: float | str | Sensor = "auto",
    sigma: float | None = None,
    tol: float = 8e-5,
    time_budget: float | None = None,
    reference: Any = None,
    callback: Callable[[State], Any] | None = None,
    progress: bool = False,
    device: str | None = None,
    threads: int | None = None,
    seed: int = 0,
    **prior_options: Any,
) -> Result:
    """Recover the video of every view from one coded picture.

    Parameters
    ----------
    y : array_like, (H, W) or (N, H, W)
        The measurement, in any unit, or N of them taken with the same masks.
    masks : array_like, (V, B, H, W) or (B, H, W), or SensingOperator
        Transmission of the mask for each view and frame, any real values; 3-D masks mean one view.
    prior : str, Prior, callable, torch.nn.Module, or sequence of (prior, iterations)
        A name (``pnp-sci priors`` lists them), names joined by "+", "auto", a function ``(x, sigma)``, or stages.
    init : str, array_like (V, B, H, W), or callable (problem, scene)
        First estimate: "adjoint", a decoder, or a video in the units of the result. "auto" is "ofanet-fast" beside a
        network, if it has weights for such masks, else "adjoint". A named decoder counts in a noisy result.
    algorithm : "gap", "plain-gap" or "admm"
    effort : "fast", "balanced" or "best"
        How many iterations are made at most, and which prior "auto" stands for.
    scene : "auto", "full" or SceneModel
        What to model: "auto" drops dark views, and models a still scene by one frame per view.
    iterations : int, optional
        At most so many; by default as `effort` and the prior say.
    noise : "auto", float, or Sensor
        Standard deviation of the noise of y, in its units. A :class:`~pnp_sci.Sensor` says more of the camera.
    sigma : float, optional
        Standard deviation that the prior is told, where x spans about [0, 1]; by default a rule decides.
    tol : float
        Stop when the measurement of the estimate changes by less than this share of ``||y||`` five times in a row.
    time_budget : float, optional
        Seconds for the whole call; the best estimate by then is returned.
    reference : array_like, optional
        The truth, for PSNR and SSIM in the history: floats in [0, 1], uint8 or uint16.
    callback : callable, optional
        Called with each `State`; a true value stops the solver, and leaves further measurements as they begin.
    progress : bool
    device : str, optional
        Where networks run, such as "cuda"; by default the CPU.
    threads : int, optional
        At most so many of the CPU.
    seed : int
        For priors that draw random numbers.
    **prior_options
        For the prior's constructor, such as ``strength=2.0``.

    Returns
    -------
    Result
        ``Result.x`` is (V, B, H, W), or (N, V, B, H, W), in the units of y over those of the masks; float64 if y is,
        else float32. A numerical failure is a `Status`, never an exception.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used: the message names it, what came and what was expected.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.solve(scene.y, scene.masks, iterations=20).x.shape
    (2, 10, 64, 64)
    """
    began = time.perf_counter()
    measurements = check_measurement(y)
    op, largest = check_operator(masks, measurements)
    request = check_request(
        op, len(measurements),
        prior=prior, prior_options=prior_options, init=init, algorithm=algorithm, effort=effort, scene=scene,
        iterations=iterations, noise=noise, sigma=sigma, tol=tol, time_budget=time_budget, callback=callback,
        progress=progress, device=device, threads=threads, seed=seed,
    )  # fmt: skip
    truth = Reference(reference, (len(measurements), *op.shape)) if reference is not None else None
    _warn_of_lost_views(op)
    warn_if_saturated(noise, measurements)

    videos = np.empty((len(measurements), *op.shape), op.dtype)
    outcomes: list[Outcome] = []
    with limited(request.threads), watching(callback, progress) as watch:
        for n, measurement in enumerate(measurements):
            deadline = _share_of_time(began, request.time_budget, len(measurements) - n)
            problem = pose(op, largest, measurement, request.sensor)
            outcomes.append(
                untouched(problem, videos[n], n)
                if watch.stopped
                else reconstruct(problem, request, videos[n], deadline=deadline, watch=watch, truth=truth, n=n)
            )
    began += truth.seconds if truth else 0.0  # the metrics are not the solver's time
    problems = [outcome.problem for outcome in outcomes]
    return Result(
        videos if np.ndim(y) == 3 else videos[0],
        Status.worst([outcome.status for outcome in outcomes]),
        History(record for outcome in outcomes for record in outcome.records),
        package_settings(request, outcomes) | provenance(y, masks, largest, problems, began),
        [outcome.scene for outcome in outcomes],
    )


def decode(
    y: Any,
    masks: Any,
    model: Any = "ofanet",
    *,
    noise: float | str | Sensor = "auto",
    scene: str | SceneModel = "auto",
    **options: Any,
) -> Result:
    """Recover the video of every view with a network alone, without iterations.

    Parameters
    ----------
    y, masks, noise, scene
        As for :func:`solve`.
    model : str, or callable (problem, scene)
        An installed decoder (``pnp-sci priors`` lists them), or an object that is one.
    **options
        For the decoder's constructor, such as ``device="cuda"``.

    Returns
    -------
    Result

    Raises
    ------
    UnknownPluginError
        If no decoder of this name is installed.
    InputError, InputTypeError
        If an argument cannot be used, or the model is not for such masks.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.decode(scene.y, scene.masks, model="ofanet-fast").x.shape
    (2, 10, 64, 64)
    """
    began = time.perf_counter()
    decoder = as_decoder(model, **options)
    measurements = check_measurement(y)
    op, largest = check_operator(masks, measurements)
    sensor = check_noise(noise)
    check_scene(scene, op)
    videos = np.empty((len(measurements), *op.shape), op.dtype)
    statuses, records, problems, scenes = [], [], [], []
    for n, measurement in enumerate(measurements):
        start = time.perf_counter()
        problem = pose(op, largest, measurement, sensor)
        chosen = choose_scene(scene if decoder.needs_scene else "full", problem)
        x = shaped("what the decoder returns", decoder(problem, chosen), op.shape, op.dtype)
        seconds = time.perf_counter() - start
        put(x, videos[n], problem.unit)
        statuses.append(Status.DECODED if np.isfinite(x).all() else Status.NOT_FINITE)
        records.append(Record(0, seconds, _relative_residual(problem, x), float("nan"), measurement=n))
        problems.append(problem)
        scenes.append(chosen.describe(op))
    return Result(
        videos if np.ndim(y) == 3 else videos[0],
        Status.worst(statuses),
        History(records),
        {"model": model if isinstance(model, str) else repr(model), "model_options": as_plain(options)}
        | provenance(y, masks, largest, problems, began),
        scenes,
    )


def _share_of_time(began: float, budget: float | None, left: int) -> float | None:
    """The moment by which the next of so many measurements that are left must be done."""
    now = time.perf_counter()
    return None if budget is None else now + (began + budget - now) / left


def _relative_residual(problem: Problem, x: np.ndarray) -> float:
    x = x if np.isfinite(x).all() else np.zeros_like(x)
    return length(problem.y - problem.op.forward(x)) / (length(problem.y) or 1.0)


def _warn_of_lost_views(op: SensingOperator) -> None:
    """Log what the masks make impossible; the solver goes on all the same."""
    if not op.masks.any():
        _log.warning("masks are all 0: nothing is measured, and the first estimate is as good as any")
    elif not views_are_separable(op.masks):
        _log.warning(
            "masks of the views are too much alike, or those of one are all 0: the views cannot be told apart; "
            "see pnp_sci.condition(masks)"
        )


__all__ = ["decode", "solve"]
