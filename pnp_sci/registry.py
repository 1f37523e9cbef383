"""Finds priors, initialisers and decoders by name: those of installed packages and those registered by hand."""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any

from .errors import UnknownPluginError

_LEARNED = {"torch", "safetensors"}  # what the extra of this name installs
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
        names = ", ".join(plugins) or "none installed"
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
    prior : callable
        A class or function that takes the options of ``solve(..., **prior_options)`` and returns a denoiser.

    Examples
    --------
    >>> register_prior("halved", lambda: lambda x, sigma: x / (1 + sigma))
    >>> "halved" in available("priors")
    True
    """
    _registered["priors"][name] = prior
