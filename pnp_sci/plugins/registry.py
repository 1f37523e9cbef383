"""Finds priors and decoders by name: those of installed packages and those registered by hand."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pnp_sci._validate import shown
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError

LEARNED = "torch", "safetensors"  # what networks need, and the extra of this name installs
BUILT_IN = {"priors": ("auto", "none"), "decoders": ("auto", "adjoint")}  # known without a plugin
_registered: dict[str, dict[str, Any]] = {"priors": {}, "decoders": {}}


@cache
def _installed(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=f"pnp_sci.{kind}")}


def available(kind: str) -> dict[str, Any]:
    """All plugins of a kind ("priors" or "decoders") by name: entry points, not yet loaded, and objects."""
    return dict(sorted((_installed(kind) | _registered[kind]).items()))


def installed(kind: str, name: str) -> Any:
    """The plugin of an installed package of that name, whatever has been registered by hand; None if there is none."""
    point = _installed(kind).get(name)
    return None if point is None else point.load()


def load(kind: str, name: str, argument: str = "") -> Any:
    """The plugin of that name: a class or function that makes a prior or a decoder from options.

    Raises
    ------
    UnknownPluginError
        If there is none of that name, or what it needs is not installed: the message lists those there are.
    """
    plugins = available(kind)
    if not isinstance(name, str) or name not in plugins:
        built_in = BUILT_IN[kind] if argument in ("", "init") else ()
        names = ", ".join([*built_in, *plugins]) or "none installed"
        raise UnknownPluginError(f"{argument or kind[:-1]} is {shown(name)}: one of these was expected: {names}")
    if name in _registered[kind]:
        return _registered[kind][name]
    try:
        return plugins[name].load()
    except ModuleNotFoundError as missing:
        raise UnknownPluginError(_needs(kind, name, missing)) from missing
    except Exception as error:  # the code of others may raise anything
        why = f"{type(error).__name__}: {error}"
        raise UnknownPluginError(f"{kind[:-1]} {name!r} is installed, but cannot be loaded: {why}") from error


def makers(kind: str) -> dict[str, str]:
    """Names of plugins by the name of the class or function that makes them."""
    of_packages = {point.attr: name for name, point in _installed(kind).items()}
    return of_packages | {getattr(factory, "__name__", name): name for name, factory in _registered[kind].items()}


def _needs(kind: str, name: str, missing: ModuleNotFoundError) -> str:
    package = str(missing.name).partition(".")[0]
    wanted = '".[learned]" in the folder of the sources' if package in LEARNED else package
    return (
        f"{kind[:-1]} {name!r} needs the module {missing.name!r}, which is not installed: "
        f"python -m pip install {wanted}"
    )


def register_prior(name: str, prior: Any) -> None:
    """Make a prior known by name in this process, for notebooks and tests.

    Parameters
    ----------
    name : str
        Without "+", ":" and ",", which combine priors; not "auto" or "none", which are taken.
    prior : callable
        A class or function that takes the options of ``solve(..., **prior_options)`` and returns a prior: a
        :class:`~pnp_sci.Prior`, a function ``(x, sigma)``, or a module of torch.

    Raises
    ------
    InputError, InputTypeError
        If the name cannot be, or `prior` cannot be called.

    Examples
    --------
    >>> register_prior("halved", lambda: lambda x, sigma: x / (1 + sigma))
    >>> "halved" in available("priors")
    True
    """
    _register("priors", name, prior)


def register_decoder(name: str, decoder: Any) -> None:
    """Make a decoder known by name in this process, for ``decode(model=name)`` and ``solve(init=name)``.

    Parameters
    ----------
    name : str
        As for :func:`register_prior`; not "auto" or "adjoint".
    decoder : callable
        A class or function that takes the options of ``decode(..., **options)`` and returns a
        :class:`~pnp_sci.Decoder` or a function ``(problem, scene)``.

    Raises
    ------
    InputError, InputTypeError
        If the name cannot be, or `decoder` cannot be called.

    Examples
    --------
    >>> import numpy as np
    >>> register_decoder("black", lambda: lambda problem, scene: np.zeros(problem.op.shape))
    >>> "black" in available("decoders")
    True
    """
    _register("decoders", name, decoder)


def _register(kind: str, name: str, factory: Any) -> None:
    taken = BUILT_IN[kind]
    if not isinstance(name, str) or not name or set(name) & set("+:,") or name in taken:
        expected = f"a name without +, : and , other than {' and '.join(taken)} was expected"
        raise InputError(f"name is {shown(name)}: {expected}")
    if not callable(factory):
        raise InputTypeError(f"{kind[:-1]} is {shown(factory)}: a class or function that makes one was expected")
    _registered[kind][name] = factory
