"""From a measurement to videos: ``solve`` with a prior, step by step with ``iterate``, or ``decode`` with a network."""

from __future__ import annotations

import hashlib
import inspect
import logging
import platform
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from functools import cache, partial
from importlib.metadata import version
from typing import Any

import numpy as np

from pnp_sci._validate import instance, number, one_of, shaped, whole
from pnp_sci.accel.threads import limited
from pnp_sci.advice.recommend import prior_within
from pnp_sci.errors import InputError
from pnp_sci.masks import views_are_separable
from pnp_sci.pipeline.blend import mixed
from pnp_sci.pipeline.defaults import EFFORTS, choose_scene, most_iterations, prior_for
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import Stages, first_of, weights_of
from pnp_sci.plugins.resolve import Reference, as_plain, describe, first_estimate, make_prior
from pnp_sci.results.result import History, Record, Result, Status
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem, check_measurement, check_noise, check_operator, pose
from pnp_sci.sensing.scene_model import SceneModel
from pnp_sci.sensing.sensor import Sensor, warn_if_saturated
from pnp_sci.solvers import ALGORITHMS, State
from pnp_sci.solvers.iterate import Limits, iterate, run
from pnp_sci.solvers.plan import contrast, schedule_for

JUDGING = 0.25  # of a time budget, to find out what of a scene has to be modelled
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
    prior : str, callable, torch.nn.Module, or sequence of (prior, iterations)
        A name (``pnp-sci priors`` lists them) or "auto"; names joined by "+" work together; a callable ``(x, sigma)``;
        a sequence runs its members one after the other, such as ``[("tv", 60), ("wavelet", 20)]``.
    init : str, array_like (V, B, H, W), or callable
        The first estimate: "adjoint", an installed initialiser, or a video in the units of the result. "auto" is
        "ofanet-fast" on the CPU beside a learned prior (alone or joined by "+"), where there are weights for so many
        views and frames, and else "adjoint". An initialiser that is a decoder too, as both of OFaNet are, counts in the
        result where y is noisy, or looks so, up to 0.5: the two err differently. ``Result.settings["share"]`` says how
        much, for each measurement and each view that was modelled.
    algorithm : "gap", "plain-gap" or "admm"
        "gap" is accelerated, with a regularised projection where there is noise.
    effort : "fast", "balanced" or "best"
        At most 50, 100 or 200 iterations; where fewer than 4 frames of all views are modelled, 15 % less for each that
        is missing, but 50 at least. With a thorough prior, which `flow`, `bm3d`, `both` and all learned ones are, as
        many as it leaves to TV (`flow`, `video` and `both` 60, others 30), 30 at least, and then 20, 30 or 30; from 20
        frames of all views on 1.5 more for each with "balanced", from 12 on 2.5 with "best", up to 50; with noise down
        to 20. `iterations` overrules that. And what the prior "auto" stands for: "tv", "video" or "both"; where PyTorch
        is missing, "flow" for the latter two. With a `time_budget`, "auto" is the prior that has most to show by then,
        with the iterations of "best", whatever the effort; see :func:`pnp_sci.recommend`.
    scene : "auto", "full" or SceneModel
        What to model. "auto" drops views that are dark and models a scene in which nothing moves by one frame per view;
        `Result.scene` says what was modelled and why, which part of each view the prior has found to stand still, how
        many pixels of y are saturated, and how many every mask leaves closed.
    iterations : int, optional
        At most so many, with those that the prior leaves to TV; by default as `effort` says, or as many as the stages
        of the prior have.
    noise : "auto", float, or Sensor
        Standard deviation of the noise of y, in its units; "auto" estimates it. A :class:`~pnp_sci.Sensor` says more of
        the camera: photon noise, saturated pixels, which only bound the light from below, and grey levels.
    sigma : float, optional
        What the prior is called with, in units where x spans about [0, 1]; by default a rule on the noise and the
        number of frames decides.
    tol : float
        Stop when the measurement of the estimate changes by less than this share of ``||y||`` five times in a row; by
        less than that where masks hardly differ, being dense or many, and code only a small part of y.
    time_budget : float, optional
        Seconds for the whole call; the best there is by then is returned.
    reference : array_like, optional
        The truth, shaped as the result, for PSNR and SSIM in the history: floats in [0, 1], or uint8 or uint16
        with the type's maximum as white. The result is compared in the same units.
    callback : callable, optional
        Called with each `State`; a true value stops the solver. With a restless prior (`bm3d`; `flow`, `video` and
        `both` where frames can show motion; all of them and `ffdnet` where a view is one frame; each after the calls
        that it leaves to TV) its x and residual are those of a mean, while the solver goes on from what it has. What
        becomes of the last estimate (`flow`, `video` and `both` average it along its motion, a decoder's estimate may
        count in it) it does not see.
    progress : bool
        Show a progress bar.
    device : str, optional
        Where learned priors run, such as "cuda"; by default on the CPU.
    threads : int, optional
        At most so many of the CPU; by default as many as it has cores. For several calls side by side.
    seed : int
        For priors that draw random numbers.
    **prior_options
        For the prior's constructor, such as ``strength=2.0``.

    Returns
    -------
    Result
        ``Result.x`` is (V, B, H, W), or (N, V, B, H, W) for N measurements, in the units of y over those of the masks;
        float64 if y is, else float32. A numerical failure is a `Status`, never an exception.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used: the message names it, what came and what was expected.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> result = pnp_sci.solve(scene.y, scene.masks, iterations=20, reference=scene.truth)
    >>> result.x.shape
    (2, 10, 64, 64)
    """
    begin = time.perf_counter()
    measurements = check_measurement(y)
    op, largest = check_operator(masks, measurements)
    sensor = check_noise(noise)
    one_of("algorithm", algorithm, ALGORITHMS)
    one_of("effort", effort, EFFORTS)
    if not isinstance(scene, SceneModel):
        one_of("scene", scene, ("auto", "full"), " or a SceneModel")
    if isinstance(scene, SceneModel) and (len(scene.views) != op.shape[0] or not any(scene.views)):
        raise InputError(f"scene has views {scene.views}: {op.shape[0]} were expected, one of them True at least")
    tol, seed = number("tol", tol), whole("seed", seed, 0)
    iterations = None if iterations is None else whole("iterations", iterations, 1)
    time_budget = None if time_budget is None else number("time_budget", time_budget)
    sigma = None if sigma is None else number("sigma", sigma)
    instance("callback", callback, Callable)  # type: ignore[arg-type]
    instance("progress", progress, bool)
    instance("device", device, str)
    threads = None if threads is None else whole("threads", threads, 1)
    within = effort
    if isinstance(prior, str) and prior == "auto":
        if time_budget is not None:
            prior, within = prior_within(time_budget / len(measurements), op.shape), "best"
        else:
            prior = prior_for(effort)
    denoiser = make_prior(prior, device=device, seed=seed, **prior_options)
    most = denoiser.calls if iterations is None and isinstance(denoiser, Stages) else iterations
    learned, first = getattr(denoiser, "learned", False), first_of(denoiser)
    allow = partial(most_iterations, within, first)
    at_most = most or allow(op.shape[0] * op.shape[1])
    restless = partial(getattr, denoiser, "restless", False)
    improve: Any = getattr(denoiser, "finish", None)
    truth = Reference(reference, (len(measurements), *op.shape)) if reference is not None else None
    _warn_of_lost_views(op)
    warn_if_saturated(noise, measurements)

    videos = np.empty((len(measurements), *op.shape), op.dtype)
    statuses, records, problems, scenes, allowed, shares, starts = [], [], [], [], [], [], set()
    with limited(threads), _bar(progress, at_most * len(measurements)) as advance:

        def observe(state: State, record: Record) -> bool:
            advance(record)
            return bool(callback(state)) if callback else False

        for n, measurement in enumerate(measurements):
            deadline, until = None, np.inf
            if time_budget is not None:
                now = time.perf_counter()
                deadline = now + (begin + time_budget - now) / (len(measurements) - n)
                until = now + JUDGING * (deadline - now)
            problem = pose(op, largest, measurement, sensor)
            model = choose_scene(scene, problem, prior, until)
            reduced = model.reduce(op)
            name, start = first_estimate(init, problem, learned)
            starts.add(name)
            start = model.restrict(start)
            states = iterate(
                reduced, problem.y, denoiser, start,
                algorithm=algorithm, noise=problem.noise, sigma=sigma, saturated=problem.saturated,
            )  # fmt: skip
            other = start if name in registry.available("decoders") else None
            parts = [0.0] * reduced.shape[0]
            del start  # it is freed after the first step, but for a decoder's

            def score(x: np.ndarray, n: int = n, model: SceneModel = model, unit: float = problem.unit):
                return truth.psnr(model.expand(x, op.shape), n, unit) if truth else None

            def finish(state: State, problem=problem, reduced=reduced, other=other, parts=parts) -> State:
                x = state.x
                if callable(improve):
                    x = shaped("what the prior's finish returns", improve(x, state.sigma), reduced.shape, op.dtype)
                if other is not None:
                    x, parts[:] = mixed(problem, x, other)
                return replace(state, x=x, residual=problem.y - reduced.forward(x))

            described = model.describe(op)
            plan = schedule_for(reduced, problem.noise, sigma)
            allowed.append(most or allow(described["frames_modelled"], plan))
            limits = Limits(allowed[-1], tol * contrast(reduced), deadline, least=first or 0)
            state, status, course = run(
                states, problem.y, limits, observe, score, problem.saturated, restless,
                finish if callable(improve) or other is not None else None,
            )  # fmt: skip
            x = model.expand(state.x, op.shape)
            _put(x if np.isfinite(x).all() else np.zeros_like(x), videos[n], problem.unit)
            statuses.append(status)
            problems.append(problem)
            shares.append(parts)
            lost = 0 if problem.saturated is None else int(problem.saturated.sum())
            described["at_rest"] = model.at_rest(getattr(denoiser, "at_rest", []))
            scenes.append(described | {"saturated": lost, "closed": int((op.gram == 0).sum())})
            records += [replace(record, measurement=n) for record in course]
            if truth and course:
                records[-1] = replace(records[-1], ssim=truth.ssim(videos[n], n))

    settings = {
        "prior": describe(prior, denoiser),
        "prior_options": as_plain(prior_options),
        "weights": weights_of(denoiser),
        "init": starts.pop() if len(starts) == 1 else "auto",
        "share": shares,
        "algorithm": algorithm,
        "effort": effort,
        "iterations": max(allowed),
        "noise": [p.typical_noise * p.unit * largest for p in problems],
        "sensor": asdict(sensor),
        "sigma": sigma,
        "tol": tol,
        "time_budget": time_budget,
        "device": device,
        "threads": threads,
        "seed": seed,
    }
    x = videos if np.ndim(y) == 3 else videos[0]
    aside = truth.seconds if truth else 0.0  # the metrics are not the solver's time
    found = scenes[0] if np.ndim(y) == 2 else {"measurements": scenes}
    return Result(
        x,
        Status.worst(statuses),
        History(records),
        settings | _provenance(y, masks, problems, begin + aside),
        found,
    )


def decode(y: Any, masks: Any, model: str = "ofanet", **options: Any) -> Result:
    """Recover the video of every view with a network alone, without iterations.

    Parameters
    ----------
    y, masks
        As for :func:`solve`.
    model : str
        An installed decoder.
    **options
        For the decoder.

    Returns
    -------
    Result

    Raises
    ------
    UnknownPluginError
        If no decoder of this name is installed.
    InputError, InputTypeError
        If an argument cannot be used, or the model is not for such masks.
    """
    begin = time.perf_counter()
    decoder = registry.load("decoders", model)
    measurements = check_measurement(y)
    op, largest = check_operator(masks, measurements)
    try:
        inspect.signature(decoder).bind(op, measurements[0], **options)
    except TypeError as error:
        raise InputError(f"options of model {model!r}: {error}") from error
    videos = np.empty((len(measurements), *op.shape), op.dtype)
    statuses, records, problems = [], [], []
    for n, measurement in enumerate(measurements):
        start = time.perf_counter()
        problem = pose(op, largest, measurement, Sensor(0.0))
        x = shaped("what the decoder returns", decoder(op, problem.y, **options), op.shape, op.dtype)
        seconds = time.perf_counter() - start
        statuses.append(Status.DECODED if np.isfinite(x).all() else Status.NOT_FINITE)
        x = x if statuses[-1].ok else np.zeros_like(x)
        residual = float(np.linalg.norm(problem.y - op.forward(x)) / (np.linalg.norm(problem.y) or 1))
        records.append(Record(0, seconds, residual, float("nan"), measurement=n))
        problems.append(problem)
        _put(x, videos[n], problem.unit)
    settings = {"model": model, "model_options": as_plain(options)} | _provenance(y, masks, problems, begin)
    return Result(videos if np.ndim(y) == 3 else videos[0], Status.worst(statuses), History(records), settings)


def _put(x: np.ndarray, video: np.ndarray, unit: float) -> None:
    """video <- x * unit, as far as the type reaches: an estimate may be larger than what y and the masks allow."""
    with np.errstate(over="ignore"):
        np.multiply(x, video.dtype.type(unit), out=video)
    np.nan_to_num(video, copy=False)


def _warn_of_lost_views(op: SensingOperator) -> None:
    """Log what the masks make impossible; the solver goes on all the same."""
    if not op.masks.any():
        _log.warning("masks are all 0: nothing is measured, and the first estimate is as good as any")
    elif not views_are_separable(op.masks):
        _log.warning(
            "masks of the views are too much alike, or those of one are all 0: the views cannot be told apart; "
            "see pnp_sci.condition(masks)"
        )


@contextmanager
def _bar(shown: bool, total: int) -> Iterator[Callable[[Record], None]]:
    """What to call with each record, so that a progress bar moves; nothing is shown, or loaded, if not `shown`."""
    if not shown:
        yield lambda record: None
        return
    from tqdm.auto import tqdm

    with tqdm(total=total, unit="it", leave=False) as bar:

        def advance(record: Record) -> None:
            if record.iteration:
                bar.set_postfix_str(f"residual {record.residual:.4f}", refresh=False)
                bar.update()

        yield advance


def _provenance(y: Any, masks: Any, problems: list[Problem], begin: float) -> dict[str, Any]:
    """What every result says of its input and of the software that made it."""
    return {
        "unit": [problem.unit for problem in problems],
        "y": _digest(y),
        "masks": _digest(masks.masks if isinstance(masks, SensingOperator) else masks),
        "versions": dict(_versions("torch" in sys.modules)),
        "seconds": time.perf_counter() - begin,
    }


@cache
def _versions(torch: bool) -> dict[str, str]:
    packages = ("pnp-sci", "numpy", "numba", *(("torch",) if torch else ()))
    return {p: version(p) for p in packages} | {"python": platform.python_version()}


def _digest(array: Any) -> str:
    """SHA-256 of the values as they came, in C order."""
    return hashlib.sha256(np.ascontiguousarray(array).data).hexdigest()


__all__ = ["decode", "solve"]
