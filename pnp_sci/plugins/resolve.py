"""What the arguments of ``solve`` stand for: a prior, a first estimate, a reference, numbers."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pnp_sci._validate import real_array, require_finite, shaped, white, whole
from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.metrics import psnr, ssim
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import Joint, Stages, TorchDenoiser, is_torch_module
from pnp_sci.plugins.protocols import Denoiser
from pnp_sci.sensing.problem import Problem, level
from pnp_sci.solvers import missing
from pnp_sci.solvers.iterate import EXPLODED, length

NETWORK = "ofanet-fast"  # the quickest of the first estimates that are better than "adjoint"


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
        if prior == "auto":
            raise InputError("prior 'auto' stands alone: in a combination, the names of priors were expected")
        factory = registry.load("priors", prior)
        taken = {k: v for k, v in options.items() if k in inspect.signature(factory).parameters}
        used.update(taken)
        try:
            return factory(**taken)
        except (InputError, InputTypeError):
            raise
        except (TypeError, ValueError, OverflowError) as error:  # a prior may not look at the types it is given
            given = {k: v for k, v in taken.items() if k not in ("device", "seed")}
            raise InputTypeError(f"prior {prior!r} cannot be made with {given}: {error}") from error
    if is_torch_module(prior):
        return TorchDenoiser(prior, options["device"])
    if isinstance(prior, Denoiser) and not isinstance(prior, type):
        return prior
    if isinstance(prior, Sequence) and prior and all(isinstance(s, Sequence) and len(s) == 2 for s in prior):
        for _, calls in prior:
            whole("iterations of a stage of prior", calls, 1)
        later = {"first": 0, **options}  # whoever comes after another finds the scene estimated already
        made = [_make(stage, options if n == 0 else later, used) for n, (stage, _) in enumerate(prior)]
        return Stages([(denoiser, int(calls)) for denoiser, (_, calls) in zip(made, prior)])
    raise InputTypeError(
        f"prior is {prior!r}: a name, a callable (x, sigma), a torch module or a sequence of (prior, iterations) "
        "was expected"
    )


def _identity(x: np.ndarray, sigma: float) -> np.ndarray:
    return x.copy()


def first_estimate(init: Any, problem: Problem, learned: bool = False) -> tuple[str, np.ndarray]:
    """Name of the start that an `init` argument of :func:`solve` stands for, and that (V, B, H, W), in problem's units.

    Beside a learned prior "auto" is the network's, where it is installed and has weights for such masks.
    """
    if isinstance(init, str) and init == "auto":
        try:
            return first_estimate(NETWORK if learned else "adjoint", problem)
        except FormatError:  # weights that are damaged
            raise
        except InputError:
            return first_estimate("adjoint", problem)
    op = problem.op
    if isinstance(init, str):
        x = level(op, problem.y) if init == "adjoint" else registry.load("inits", init)(op, problem.y)
    elif callable(init) and not isinstance(init, type):
        x = init(op, problem.y)
    else:
        with np.errstate(all="ignore"):  # what the type cannot hold is told below
            x = real_array("init", init) / np.float64(problem.unit)
    x = shaped("init", x, op.shape, op.dtype)
    require_finite("init", x)
    share = length(missing(problem.y - op.forward(x), problem.saturated)) / (length(problem.y) or 1.0)
    if not isinstance(init, str) and problem.y.any() and share > EXPLODED:
        raise InputError(f"init leaves a residual of {share:.3g} times y: an estimate in the units of y was expected")
    return init if isinstance(init, str) else type(init).__name__, x


class Reference:
    """The truth, and how close a video comes to it."""

    def __init__(self, reference: Any, shape: tuple[int, ...]):
        array = real_array("reference", reference)
        if _longer_than_one(array.shape) != _longer_than_one(shape):
            raise InputError(f"reference has shape {array.shape}: {shape[1:] if shape[0] == 1 else shape} was expected")
        self.white = white("reference", array.dtype)
        self.array = array.reshape(shape)
        self.seconds = 0.0  # that the metrics have taken

    def psnr(self, x: np.ndarray, n: int, unit: float = 1.0) -> float:
        """Mean over the views of measurement n, for x in so many of the reference's units."""
        return self._mean(psnr, x, n, unit)

    def ssim(self, x: np.ndarray, n: int) -> float:
        """Mean over the views, of measurement n."""
        return self._mean(ssim, x, n)

    def _mean(self, metric: Callable[..., Any], x: np.ndarray, n: int, unit: float = 1.0) -> float:
        begin = time.perf_counter()
        with np.errstate(over="ignore"):  # metrics clip to [0, 1]
            mean = float(np.mean(metric(x * (unit / self.white), self.array[n] / self.white)))
        self.seconds += time.perf_counter() - begin
        return mean


def _longer_than_one(shape: tuple[int, ...]) -> list[int]:
    return [length for length in shape if length > 1]


def describe(prior: Any, denoiser: Denoiser) -> Any:
    """A `prior` argument as JSON can hold it: by name where it has one, so that it can be given again."""
    if isinstance(prior, str):
        return prior
    if isinstance(denoiser, Stages) and prior is not denoiser:
        return [[describe(p, d), int(c)] for (p, c), (d, _) in zip(prior, denoiser.stages)]
    return repr(prior)


def as_plain(options: dict[str, Any]) -> dict[str, Any]:
    """Options as JSON can hold them."""
    return {k: v if v is None or isinstance(v, (bool, int, float, str)) else repr(v) for k, v in options.items()}
