"""Finds priors, initialisers and decoders by name: those of installed packages and those registered by hand."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError

_LEARNED = {"torch", "safetensors"}  # what the extra of this name installs
BUILT_IN = {"priors": ("auto", "none"), "inits": ("auto", "adjoint")}  # known without a plugin
_registered: dict[str, dict[str, Any]] = {"priors": {}, "inits": {}, "decoders": {}}


@cache
def _installed(kind: str) -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=f"pnp_sci.{kind}")}


def available(kind: str) -> dict[str, Any]:
    """All plugins of a kind ("priors", "inits" or "decoders") by name: entry points, not yet loaded, and objects."""
    return dict(sorted((_installed(kind) | _registered[kind]).items()))


def load(kind: str, name: str) -> Any:
    """The plugin of that name: for priors a class or function that makes one, for the others the callable itself.

    Raises
    ------
    UnknownPluginError
        If there is none of that name, or what it needs is not installed: the message lists those there are.
    """
    plugins = available(kind)
    if not isinstance(name, str) or name not in plugins:
        names = ", ".join([*BUILT_IN.get(kind, ()), *plugins]) or "none installed"
        raise UnknownPluginError(f"{kind[:-1]} is {name!r}: one of these was expected: {names}")
    plugin = plugins[name]
    if not isinstance(plugin, EntryPoint):
        return plugin
    try:
        return plugin.load()
    except ModuleNotFoundError as missing:
        raise UnknownPluginError(_needs(kind, name, missing)) from missing


def _needs(kind: str, name: str, missing: ModuleNotFoundError) -> str:
    package = str(missing.name).partition(".")[0]
    wanted = '"pnp-sci[learned]"' if package in _LEARNED else package
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
        A class or function that takes the options of ``solve(..., **prior_options)`` and returns a denoiser.

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
    if not isinstance(name, str) or not name or set(name) & set("+:,") or name in BUILT_IN["priors"]:
        raise InputError(f"name is {name!r}: a name without +, : and , other than auto and none was expected")
    if not callable(prior):
        raise InputTypeError(f"prior is {prior!r}: a class or function that makes a denoiser was expected")
    _registered["priors"][name] = prior
