"""What the arguments of ``solve`` stand for: a prior, a first estimate, a reference, numbers."""

from __future__ import annotations

import inspect
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import registry
from .compose import Joint, Stages, TorchDenoiser, is_torch_module
from .errors import InputError, InputTypeError
from .metrics import psnr, ssim
from .problem import Problem, level
from .protocols import Denoiser


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
    if isinstance(prior, Denoiser):
        return prior
    if isinstance(prior, Sequence) and prior and all(isinstance(s, Sequence) and len(s) == 2 for s in prior):
        for _, calls in prior:
            if not isinstance(calls, (int, np.integer)) or calls < 1:
                raise InputError(f"prior has a stage of {calls!r} iterations: a whole number >= 1 was expected")
        later = {"first": 0, **options}  # whoever comes after another finds the scene estimated already
        made = [_make(stage, options if n == 0 else later, used) for n, (stage, _) in enumerate(prior)]
        return Stages([(denoiser, int(calls)) for denoiser, (_, calls) in zip(made, prior)])
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


class Reference:
    """The truth, and how close a video comes to it."""

    def __init__(self, reference: Any, shape: tuple[int, ...]):
        array = np.asarray(reference)
        if array.size != np.prod(shape):
            raise InputError(f"reference has shape {array.shape}: {shape[1:] if shape[0] == 1 else shape} was expected")
        self.white = float(np.iinfo(array.dtype).max) if array.dtype.kind in "iu" else 1.0
        self.array = array.reshape(shape)

    def psnr(self, x: np.ndarray, n: int, unit: float = 1.0) -> float:
        """Mean over the views of measurement n, for x in so many of the reference's units."""
        return float(np.mean(psnr(x * unit / self.white, self.array[n] / self.white)))

    def ssim(self, x: np.ndarray, n: int) -> float:
        """Mean over the views, of measurement n."""
        return float(np.mean(ssim(x / self.white, self.array[n] / self.white)))


def check_numbers(**numbers: Any) -> None:
    """All of them None or finite and >= 0, iterations a whole number >= 1."""
    for name, value in numbers.items():
        if value is None:
            continue
        if name == "iterations" and (not isinstance(value, (int, np.integer)) or value < 1):
            raise InputError(f"iterations is {value!r}: a whole number >= 1 was expected")
        if not isinstance(value, (int, float, np.number)) or not 0 <= value < np.inf:
            raise InputError(f"{name} is {value!r}: a finite number >= 0 was expected")


def describe(prior: Any, denoiser: Denoiser) -> Any:
    """A `prior` argument as JSON can hold it: by name where it has one, so that it can be given again."""
    if isinstance(prior, str):
        return prior
    if isinstance(denoiser, Stages):
        return [[describe(p, d), int(c)] for (p, c), (d, _) in zip(prior, denoiser.stages)]
    return repr(prior)


def as_plain(options: dict[str, Any]) -> dict[str, Any]:
    """Options as JSON can hold them."""
    return {k: v if v is None or isinstance(v, (bool, int, float, str)) else repr(v) for k, v in options.items()}
