"""From a measurement to videos: ``solve`` with a prior, step by step with ``iterate``, or ``decode`` with a network."""

from __future__ import annotations

import hashlib
import inspect
import platform
import time
from collections.abc import Callable, Sequence
from importlib.metadata import version
from typing import Any

import numpy as np

from . import registry
from .compose import Joint, Stages, TorchDenoiser, is_torch_module
from .errors import InputError, InputTypeError
from .loop import Limits, iterate, run
from .metrics import psnr, ssim
from .operator import SensingOperator
from .problem import Problem, check_measurement, check_noise, check_operator, level, pose
from .protocols import Denoiser
from .result import History, Record, Result, Status
from .solvers import ALGORITHMS, State

ITERATIONS = 100  # TV has converged to 0.05 dB by then on clips of the training set


def solve(
    y: Any,
    masks: Any,
    prior: Any = "tv",
    init: Any = "adjoint",
    *,
    algorithm: str = "gap",
    iterations: int | None = None,
    noise: float | str = "auto",
    sigma: float | None = None,
    tol: float = 1e-4,
    time_budget: float | None = None,
    reference: Any = None,
    callback: Callable[[State], Any] | None = None,
    progress: bool = False,
    device: str | None = None,
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
        A name (``pnp-sci priors`` lists them); names joined by "+" work together; a callable ``(x, sigma)``; a sequence
        runs its members one after the other, such as ``[("tv", 60), ("wavelet", 20)]``.
    init : str, array_like (V, B, H, W), or callable
        The first estimate: "adjoint", an installed initialiser, or a video in the units of the result.
    algorithm : "gap", "plain-gap" or "admm"
        "gap" is accelerated, with a regularised projection where there is noise.
    iterations : int, optional
        At most so many; by default 100, or as many as the stages of the prior have.
    noise : "auto" or float
        Standard deviation of the noise of y, in its units; "auto" estimates it.
    sigma : float, optional
        What the prior is called with, in units where x spans about [0, 1]; by default a rule on the noise decides.
    tol : float
        Stop when the measurement of the estimate changes by less than this share of ``||y||`` five times in a row.
    time_budget : float, optional
        Seconds for the whole call; the best there is by then is returned.
    reference : array_like, optional
        The truth, shaped as the result, for PSNR and SSIM in the history: floats in [0, 1] or integers with their
        type's maximum as white. The result is compared in the same units.
    callback : callable, optional
        Called with each `State`; a true value stops the solver.
    progress : bool
        Show a progress bar.
    device : str, optional
        Where learned priors run, such as "cuda"; by default on the CPU.
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
    noise = check_noise(noise)
    if algorithm not in ALGORITHMS:
        raise InputError(f"algorithm is {algorithm!r}: one of these was expected: {', '.join(ALGORITHMS)}")
    _check_numbers(iterations=iterations, tol=tol, time_budget=time_budget, sigma=sigma)
    denoiser = make_prior(prior, device=device, seed=seed, **prior_options)
    most = iterations if iterations is not None else denoiser.calls if isinstance(denoiser, Stages) else ITERATIONS
    truth = _Reference(reference, (len(measurements), *op.shape)) if reference is not None else None
    bar = _Bar(progress, most * len(measurements))

    videos = np.empty((len(measurements), *op.shape), op.dtype)
    statuses, records, problems = [], [], []
    for n, measurement in enumerate(measurements):
        deadline = None
        if time_budget is not None:
            now = time.perf_counter()
            deadline = now + (begin + time_budget - now) / (len(measurements) - n)
        problem = pose(op, largest, measurement, noise)
        states = iterate(
            op, problem.y, denoiser, first_estimate(init, problem), algorithm=algorithm, noise=problem.noise, sigma=sigma
        )

        def observe(state: State, record: Record) -> bool:
            bar.update(record)
            return bool(callback(state)) if callback else False

        score = (lambda x, n=n, unit=problem.unit: truth.psnr(x * unit, n)) if truth else None
        state, status, course = run(states, problem.y, Limits(most, tol, deadline), observe, score)
        videos[n] = state.x if np.isfinite(state.x).all() else 0
        videos[n] *= op.dtype.type(problem.unit)
        statuses.append(status)
        problems.append(problem)
        records += [_of_measurement(r, n) for r in course]
        if truth and course:
            records[-1] = _with_ssim(records[-1], truth.ssim(videos[n], n))
    bar.close()

    settings = {
        "prior": _describe(prior, denoiser),
        "prior_options": {k: v if _plain(v) else repr(v) for k, v in prior_options.items()},
        "init": init if isinstance(init, str) else type(init).__name__,
        "algorithm": algorithm,
        "iterations": most,
        "noise": [p.noise * p.unit * largest for p in problems],
        "unit": [p.unit for p in problems],
        "sigma": sigma,
        "tol": tol,
        "time_budget": time_budget,
        "device": device,
        "seed": seed,
        "seconds": time.perf_counter() - begin,
        "y": _digest(measurements),
        "masks": _digest(op.masks),
        "versions": {p: version(p) for p in ("pnp-sci", "numpy", "numba")} | {"python": platform.python_version()},
    }
    x = videos if np.ndim(y) == 3 else videos[0]
    return Result(x, Status.worst(statuses), History(records), settings)


def decode(y: Any, masks: Any, model: str = "ofanet", **options: Any) -> Result:
    """Recover the video of every view with a network alone, in one pass.

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
    """
    decoder = registry.load("decoders", model)
    begin = time.perf_counter()
    measurements = check_measurement(y)
    op, largest = check_operator(masks, measurements)
    videos = np.empty((len(measurements), *op.shape), op.dtype)
    records = []
    for n, measurement in enumerate(measurements):
        problem = pose(op, largest, measurement, 0.0)
        x = np.asarray(decoder(op, problem.y, **options), op.dtype)
        residual = float(np.linalg.norm(problem.y - op.forward(x)) / (np.linalg.norm(problem.y) or 1))
        records.append(Record(0, time.perf_counter() - begin, residual, float("nan"), measurement=n))
        videos[n] = x * op.dtype.type(problem.unit)
    settings = {"model": model, "y": _digest(measurements), "masks": _digest(op.masks)}
    return Result(videos if np.ndim(y) == 3 else videos[0], Status.DECODED, History(records), settings)


def make_prior(prior: Any, *, device: str | None = None, seed: int = 0, **options: Any) -> Denoiser:
    """The denoiser that a `prior` argument of :func:`solve` stands for.

    Options are given to those of the named priors that take them; one that none takes is an error.
    """
    used: set[str] = set()
    denoiser = _make(prior, {"device": device, "seed": seed, **options}, used)
    unknown = set(options) - used
    if unknown:
        raise InputError(f"prior {prior!r} takes no option {', '.join(sorted(unknown))}")
    return denoiser


def _make(prior: Any, options: dict[str, Any], used: set[str]) -> Denoiser:
    if isinstance(prior, str):
        if prior == "none":
            return _identity
        if "+" in prior:
            return Joint([_make(name.strip(), options, used) for name in prior.split("+")])
        factory = registry.load("priors", prior)
        taken = {k: v for k, v in options.items() if k in inspect.signature(factory).parameters}
        used.update(taken)
        return factory(**taken)
    if is_torch_module(prior):
        return TorchDenoiser(prior, options["device"])
    if callable(prior):
        return prior
    if isinstance(prior, Sequence) and prior and all(isinstance(s, Sequence) and len(s) == 2 for s in prior):
        for _, calls in prior:
            if not isinstance(calls, (int, np.integer)) or calls < 1:
                raise InputError(f"prior has a stage of {calls!r} iterations: a whole number >= 1 was expected")
        return Stages([(_make(stage, options, used), int(calls)) for stage, calls in prior])
    raise InputTypeError(
        f"prior is {prior!r}: a name, a callable (x, sigma), a torch module or a sequence of (prior, iterations) "
        "was expected"
    )


def _identity(x: np.ndarray, sigma: float) -> np.ndarray:
    return x.copy()


def first_estimate(init: Any, problem: Problem) -> np.ndarray:
    """The start (V, B, H, W) that an `init` argument of :func:`solve` stands for, in the units of the problem."""
    op = problem.op
    if isinstance(init, str):
        x = level(op, problem.y) if init == "adjoint" else registry.load("inits", init)(op, problem.y)
    elif callable(init):
        x = init(op, problem.y)
    else:
        x = np.asarray(init, op.dtype) / op.dtype.type(problem.unit)
    x = np.ascontiguousarray(x, op.dtype)
    if x.shape != op.shape or not np.isfinite(x).all():
        raise InputError(f"init gives an array of shape {x.shape}: finite values of shape {op.shape} were expected")
    return x


class _Reference:
    """The truth, and how close a video comes to it."""

    def __init__(self, reference: Any, shape: tuple[int, ...]):
        array = np.asarray(reference)
        if array.size != np.prod(shape):
            raise InputError(f"reference has shape {array.shape}: {shape[1:] if shape[0] == 1 else shape} was expected")
        self.white = float(np.iinfo(array.dtype).max) if array.dtype.kind in "iu" else 1.0
        self.array = array.reshape(shape)

    def psnr(self, x: np.ndarray, n: int) -> float:
        return float(np.mean(psnr(x / self.white, self.array[n] / self.white)))

    def ssim(self, x: np.ndarray, n: int) -> float:
        return float(np.mean(ssim(x / self.white, self.array[n] / self.white)))


class _Bar:
    """A progress bar, or nothing."""

    def __init__(self, shown: bool, total: int):
        self._bar = None
        if shown:
            from tqdm.auto import tqdm

            self._bar = tqdm(total=total, unit="it", leave=False)

    def update(self, record: Record) -> None:
        if self._bar is not None and record.iteration:
            self._bar.update()
            self._bar.set_postfix(residual=f"{record.residual:.4f}", refresh=False)

    def close(self) -> None:
        if self._bar is not None:
            self._bar.close()


def _check_numbers(**numbers: Any) -> None:
    """All of them None or finite and >= 0, iterations a whole number >= 1."""
    for name, value in numbers.items():
        if value is None:
            continue
        if name == "iterations" and (not isinstance(value, (int, np.integer)) or value < 1):
            raise InputError(f"iterations is {value!r}: a whole number >= 1 was expected")
        if not isinstance(value, (int, float, np.number)) or not 0 <= value < np.inf:
            raise InputError(f"{name} is {value!r}: a finite number >= 0 was expected")


def _of_measurement(record: Record, n: int) -> Record:
    return record if n == 0 else Record(**{**vars(record), "measurement": n})


def _with_ssim(record: Record, value: float) -> Record:
    return Record(**{**vars(record), "ssim": value})


def _describe(prior: Any, denoiser: Denoiser) -> Any:
    if isinstance(prior, str):
        return prior
    if isinstance(denoiser, Stages):
        return [[_describe(p, d), int(c)] for (p, c), (d, _) in zip(prior, denoiser.stages)]
    return repr(prior)


def _plain(value: Any) -> bool:
    return value is None or isinstance(value, (bool, int, float, str))


def _digest(array: np.ndarray) -> str:
    return hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()


__all__ = ["SensingOperator", "decode", "iterate", "make_prior", "solve"]
