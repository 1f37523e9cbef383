"""Plug-and-play reconstruction for snapshot compressive imaging.

Public names are loaded on first use, so that ``import pnp_sci`` is quick and never loads torch or compiles anything.
"""

from typing import Any

import lazy_loader

from pnp_sci import _moved  # noqa: F401

_attribute, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("pnp-sci")
    return _attribute(name)
