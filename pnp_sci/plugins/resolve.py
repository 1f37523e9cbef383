"""What stands for a prior or a decoder, as the object: names, functions, modules of torch, sequences."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci._validate import finite_number, real_array, require_finite, shaped, shown, whole
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import FunctionPrior, Identity, Joint, Stages
from pnp_sci.plugins.protocols import Decoder, Prior
from pnp_sci.plugins.torch_module import TorchPrior, is_torch_module


def as_prior(prior: Any, *, device: str | None = None, seed: int = 0, **options: Any) -> Prior:
    """The prior that an argument `prior` stands for.

    Parameters
    ----------
    prior : str, Prior, callable, torch.nn.Module, or sequence of (prior, iterations)
        A name; names joined by "+", which work together; a :class:`~pnp_sci.Prior`; a function ``(x, sigma)``; a
        module called the same way; or stages that follow one another.
    device : str, optional
        For priors that run on a device.
    seed : int
        For priors that draw random numbers.
    **options
        For the constructors of the named priors that take them.

    Raises
    ------
    InputError, InputTypeError
        If it stands for no prior, an option is out of its range, or no prior takes an option.

    Examples
    --------
    >>> import pnp_sci
    >>> pnp_sci.as_prior("tv", strength=2.0).strength
    2.0
    """
    used: set[str] = set()
    made = _made(prior, {"device": device, "seed": seed, **options}, used)
    if unknown := set(options) - used:
        raise InputError(f"prior {shown(prior)} takes no option {', '.join(sorted(unknown))}")
    return made


def _made(prior: Any, options: dict[str, Any], used: set[str]) -> Prior:
    if isinstance(prior, str):
        return _named(prior, options, used)
    if isinstance(prior, Prior) and not isinstance(prior, type):
        return prior
    if is_torch_module(prior) and _takes(prior, 2):
        return TorchPrior(prior, options["device"])
    if isinstance(prior, Sequence) and prior and all(_is_stage(stage) for stage in prior):
        for _, calls in prior:
            whole("iterations of a stage of prior", calls, 1)
        return Stages([(_made(stage, options, used), int(calls)) for stage, calls in prior])
    if callable(prior) and not isinstance(prior, type) and _takes(prior, 2):
        return FunctionPrior(prior)
    raise InputTypeError(
        f"prior is {_called(prior)}: a name, a Prior, a callable or torch module (x, sigma), or a sequence of "
        "(prior, iterations) was expected"
    )


def _called(thing: Any) -> str:
    """What came in place of a function, with the arguments that it takes."""
    routine = thing.forward if is_torch_module(thing) else thing
    if not inspect.isroutine(routine):
        return shown(thing)
    return f"{shown(thing)}, which takes {inspect.signature(routine)}"


def _is_stage(stage: Any) -> bool:
    return isinstance(stage, Sequence) and not isinstance(stage, str) and len(stage) == 2


def _named(prior: str, options: dict[str, Any], used: set[str]) -> Prior:
    if prior == "none":
        return Identity()
    if "+" in prior:
        return Joint([_named(name.strip(), options, used) for name in prior.split("+")])
    if prior == "auto":
        names = ", ".join(registry.available("priors"))
        raise InputError(
            f"prior is 'auto', which solve alone can choose, not in a combination: a name was expected: {names}"
        )
    factory = registry.load("priors", prior)
    taken = {name: value for name, value in options.items() if name in inspect.signature(factory).parameters}
    used.update(taken)
    _require_options("prior", prior, factory, taken)
    try:
        made = factory(**taken)
    except (InputError, InputTypeError):
        raise
    except (TypeError, ValueError, OverflowError) as error:  # a prior may not look at the types it is given
        given = {name: value for name, value in taken.items() if name not in ("device", "seed")}
        raise InputTypeError(f"prior {prior!r} cannot be made with {given}: {error}") from error
    return _made(made, options, used)  # a factory may return a function


def _require_options(kind: str, name: str, factory: Callable, options: dict[str, Any]) -> None:
    """Raise an InputTypeError if a factory cannot do without options that were not given."""
    variable = inspect.Parameter.VAR_POSITIONAL, inspect.Parameter.VAR_KEYWORD
    parameters = inspect.signature(factory).parameters.values()
    needed = [p.name for p in parameters if p.default is p.empty and p.kind not in variable and p.name not in options]
    if needed:
        expected = f"what register_{kind} takes makes a {kind} from options, as lambda: my_{kind} does"
        raise InputTypeError(f"{kind} {name!r} needs {' and '.join(needed)} as options; {expected}")


def _takes(function: Callable, arguments: int) -> bool:
    """Whether a function can be called with so many positional arguments, as far as it says."""
    try:
        inspect.signature(function.forward if is_torch_module(function) else function).bind(*range(arguments))
    except TypeError:
        return False
    except ValueError:  # some builtins tell nothing of themselves
        return True
    return True


@dataclass(frozen=True)
class FunctionDecoder(Decoder):
    """A function ``(problem, scene)`` that returns a video, as a decoder."""

    function: Callable[..., Any]
    needs_scene: bool = True

    def __call__(self, problem: Any, scene: Any) -> np.ndarray:
        """The video (V, B, H, W) that the function returns."""
        return self.function(problem, scene)


def as_decoder(decoder: Any, **options: Any) -> Decoder:
    """The decoder that a name, a :class:`~pnp_sci.Decoder` or a function ``(problem, scene)`` stands for.

    Parameters
    ----------
    decoder : str, Decoder, or callable (problem, scene)
    **options
        For the constructor of a named decoder, such as ``device="cuda"``.

    Raises
    ------
    InputError, InputTypeError
        If it stands for none, or takes no such options.

    Examples
    --------
    >>> as_decoder(lambda problem, scene: problem.op.adjoint(problem.y) / 10).needs_scene
    True
    """
    return decoder_for("decoder", decoder, options)


def decoder_for(argument: str, decoder: Any, options: dict[str, Any], device: str | None = None) -> Decoder:
    """As :func:`as_decoder`; errors name the argument that it came by. A factory that takes a device gets that."""
    if isinstance(decoder, str):
        factory = registry.load("decoders", decoder, argument)
        if device is not None and "device" in inspect.signature(factory).parameters:
            options = {"device": device, **options}
        _require_options("decoder", decoder, factory, options)
        try:
            inspect.signature(factory).bind(**options)
        except TypeError as error:
            raise InputError(f"options of decoder {decoder!r}: {error}") from error
        return decoder_for(f"decoder {decoder!r}", factory(**options), {})
    if options:
        raise InputError(f"options {', '.join(sorted(options))}: the name of a decoder was expected beside them")
    if isinstance(decoder, type) or not callable(decoder) or not _takes(decoder, 2):
        raise InputTypeError(f"{argument} is {_called(decoder)}: a name or a callable (problem, scene) was expected")
    return decoder if isinstance(decoder, Decoder) else FunctionDecoder(decoder)


def denoise(x: Any, sigma: float, prior: Any = "tv", **options: Any) -> np.ndarray:
    """Denoise a video by one call of a prior, without its warm-up.

    Parameters
    ----------
    x : array_like, (V, B, H, W)
        Views, frames, rows, columns; values about [0, 1].
    sigma : float
        Standard deviation of the noise in the same units, >= 0.
    prior, **options
        As for :func:`as_prior`.

    Returns
    -------
    ndarray, (V, B, H, W)
        A new array; float64 if x is, else float32.

    Raises
    ------
    InputError, InputTypeError
        If an argument cannot be used.

    Examples
    --------
    >>> import numpy as np, pnp_sci
    >>> x = np.zeros((1, 1, 8, 8), np.float32); x[..., 4:] = 1
    >>> noisy = x + 0.1 * np.random.default_rng(0).standard_normal(x.shape)
    >>> bool(np.std(pnp_sci.denoise(noisy, 0.1, "tv", inner=100) - x) < np.std(noisy - x))
    True
    """
    v = real_array("x", x)
    v = np.array(v, np.float64 if v.dtype == np.float64 else np.float32, order="C")
    if v.ndim != 4 or v.size == 0:
        raise InputError(f"x has shape {v.shape}: (views, frames, rows, columns) was expected, none of them 0")
    require_finite("x", v)
    sigma = finite_number("sigma", sigma)
    session = as_prior(prior, **options).begin(v.shape, v.dtype)
    return np.array(shaped("what the prior returns", session(v, sigma), v.shape, v.dtype))
