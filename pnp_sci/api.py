"""From a measurement to videos: ``solve`` with a prior, ``decode`` with a network."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.camera.registration import Registration
from pnp_sci.pipeline.input import Input
from pnp_sci.pipeline.measurement import found, put
from pnp_sci.pipeline.provenance import provenance
from pnp_sci.pipeline.request import as_plain
from pnp_sci.pipeline.solve import solve_all
from pnp_sci.pipeline.start import exploded
from pnp_sci.pipeline.unit import in_unit_of_scene
from pnp_sci.plugins.mosaic import decoded
from pnp_sci.plugins.resolve import decoder_for
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result
from pnp_sci.scene.choose import choose_scene
from pnp_sci.sensing.problem import check_noise, check_scene
from pnp_sci.sensing.scene_model import SceneModel, full
from pnp_sci.sensing.sensor import Sensor
from pnp_sci.solvers.state import State, length, start
from pnp_sci.solvers.stopping import relative_residual


def solve(
    y: Any,
    masks: Any,
    prior: Any = "tv",
    init: Any = "auto",
    *,
    algorithm: str = "gap",
    effort: str = "balanced",
    scene: str | SceneModel = "auto",
    bad: Any = None,
    iterations: int | None = None,
    noise: float | str | Sensor = "auto",
    sigma: float | None = None,
    tol: float = 8e-5,
    time_budget: float | None = None,
    reference: Any = None,
    peak: float | None = None,
    callback: Callable[[State], Any] | None = None,
    progress: bool = False,
    device: str | None = None,
    backend: str | None = None,
    threads: int | None = None,
    seed: int = 0,
    register: bool | Registration = False,
    uncertainty: bool = False,
    sequence: bool | int = False,
    mosaic: str | None = None,
    **prior_options: Any,
) -> Result:
    """Recover the video of every view from one coded picture.

    Parameters
    ----------
    y : array_like, (H, W) or (N, H, W)
        The measurement, in any unit, or N of them. Masked values are bad pixels.
    masks : array_like, (V, B, H, W), (B, H, W) or (N, V, B, H, W), or SensingOperator
        Transmission for each view and frame, any real values; 3-D masks mean one view, 5-D those of each measurement.
    prior : str, Prior, callable, torch.nn.Module, or sequence of (prior, iterations)
        A name (``pnp-sci priors``), names joined by "+", "auto", a function ``(x, sigma)``, or stages.
    init : str, array_like (V, B, H, W) or (N, V, B, H, W), or callable (problem, scene)
        First estimate: "adjoint", a decoder, or a video in the units of the result; "auto" decodes, with strong priors.
    algorithm, effort : str
        "gap", "plain-gap" or "admm"; "fast", "balanced" or "best": the most iterations, and which prior "auto" is.
    scene : "auto", "full" or SceneModel
        "auto" drops dark views, and models a still scene by one frame per view.
    bad : "auto", or array_like of bool, (H, W) or (N, H, W), optional
        Pixels of y that are not used. "auto" finds hot, dead and stuck ones, and values that are not finite.
    iterations, sigma, tol : optional
        Largest number of iterations; what the prior is told, where x spans [0, 1]. By default rules decide. Stop when
        Phi x changes by less than `tol` times ``||y||`` in five iterations in a row.
    noise : "auto", float, or Sensor
        Standard deviation of the noise of y, in its units, not in parts of the largest value as in :func:`simulate`. A
        :class:`~pnp_sci.Sensor` says more of the camera. "auto" estimates it, too large where there is much texture.
    time_budget : float, optional
        Seconds for the whole call, callback included; the last estimate by then is returned.
    reference : array_like, optional
        The truth, for PSNR and SSIM in the history, in the units of the result.
    peak : float, optional
        White in the reference. By default 255 of uint8, and 1 of floats below 2; of uint16 and other floats
        that of 8, 10, 12, 14 or 16 bits, the fewest that hold its values.
    callback : callable, optional
        Called with each `State` of what is modelled; a true value stops the solver, for all measurements.
    device, backend : str, optional
        Where to run, such as "cuda"; "torch", or "numba" on the CPU, which is the default there.
    progress, threads, seed
        Whether to show a bar; CPU threads at most; for priors that draw random numbers.
    register : bool or Registration
        First move the masks to where y has them, and subtract the black level: :func:`pnp_sci.register`.
    uncertainty : bool
        Whether to predict the error of each pixel, `Result.uncertainty`. It takes a second solve.
    sequence : bool or int
        Whether measurements follow one another in time and are solved as one video. A number (>= 3) of them are solved
        at once; by default as many as about 3 GB hold.
    mosaic : "RGGB", "BGGR", "GRBG" or "GBRG", optional
        The colour filters over the first pixels of two rows: y is raw, `x`, `init` and `reference` are in colour.
    **prior_options
        For the prior's constructor, such as ``strength=2.0``.

    Returns
    -------
    Result
        `x` is (V, B, H, W) or (N, V, B, H, W), in colour with a last axis of 3, in units of y over those of the masks;
        a failure is a `Status`.

    Raises
    ------
    InputError, InputTypeError, UnknownPluginError
        If an argument cannot be used: the message names it, what came and what was expected.

    Examples
    --------
    >>> import pnp_sci
    >>> scene = pnp_sci.datasets.embedded_scene(64)
    >>> pnp_sci.solve(scene.y, scene.masks, iterations=20).x.shape
    (2, 10, 64, 64)
    """
    return solve_all(y, masks, reference, peak, dict(
        prior=prior, prior_options=prior_options, init=init, algorithm=algorithm, effort=effort, scene=scene, bad=bad,
        iterations=iterations, noise=noise, sigma=sigma, tol=tol, time_budget=time_budget, callback=callback,
        progress=progress, device=device, backend=backend, threads=threads, seed=seed, register=register,
        uncertainty=uncertainty, sequence=sequence, mosaic=mosaic,
    ))  # fmt: skip


def decode(
    y: Any,
    masks: Any,
    model: Any = "ofanet",
    *,
    noise: float | str | Sensor = "auto",
    scene: str | SceneModel = "auto",
    bad: Any = None,
    mosaic: str | None = None,
    **options: Any,
) -> Result:
    """Recover the video of every view with a network alone, without iterations.

    Parameters
    ----------
    y, masks, noise, scene, bad, mosaic
        As for :func:`solve`.
    model : str, or callable (problem, scene)
        An installed decoder (``pnp-sci priors`` lists them), or an object that is one.
    **options
        For the decoder's constructor, such as ``device="cuda"``.

    Returns
    -------
    Result
        A remark says if the video cannot be of `y`: its values cancel each other, or leave more of `y` than zeros do.

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
    decoder = decoder_for("model", model, options)
    given = Input.of(y, masks, bad, mosaic)
    op, sensor = given.op, check_noise(noise)
    check_scene(scene, op)
    fits = given.check(sensor)
    videos = np.empty((len(fits), *op.shape), op.dtype)
    statuses, records, problems, scenes = [], [], [], []
    for n, problem in enumerate(given.problems(sensor, fits)):
        begun = time.perf_counter()
        problem = problem.steady()
        if decoder.needs_scene or scene == "full":
            chosen = choose_scene(scene, problem)
        else:
            chosen = full(problem.op, "not judged: the decoder does not need it")
        [problem] = in_unit_of_scene([problem])
        x = shaped("what the decoder returns", decoded(decoder, problem, chosen), op.shape, op.dtype)
        seconds = time.perf_counter() - begun
        put(x, videos[n], problem.unit)
        statuses.append(Status.DECODED if np.isfinite(x).all() else Status.NOT_FINITE)
        state = start(problem.op, problem.y, x if statuses[-1].ok else np.zeros_like(x))
        residual = relative_residual(state, length(problem.y) or 1.0, problem.saturated)
        records.append(Record(0, seconds, residual, float("nan"), measurement=n))
        problems.append(problem)
        scenes.append(given.found(found(chosen, problem), fits[n]))
        if statuses[-1].ok and (why := exploded(x, problem)):
            scenes[-1]["remarks"].append(f"what the decoder makes of y {why}: do not trust it")
    videos = given.shown(videos)
    return Result(
        videos if np.ndim(y) == 3 else videos[0],
        Status.worst(statuses),
        History(records),
        {"model": model if isinstance(model, str) else repr(model), "model_options": as_plain(options)}
        | {"mosaic": mosaic, "statuses": [status.name for status in statuses]}
        | provenance(y, masks, given.largest, problems, began),
        scenes,
    )


__all__ = ["decode", "solve"]
