"""Modules under their earlier names: importing one warns, and gives the names of the module in its place."""

from __future__ import annotations

import importlib
import sys
import warnings
from importlib.abc import Loader, MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_loader
from types import ModuleType
from typing import Any

MOVED = {
    "pnp_sci.judge": ("pnp_sci.scene.dark_views",),
    "pnp_sci.operator": ("pnp_sci.sensing.operator",),
    "pnp_sci.recommend": ("pnp_sci.advice.recommend",),
    "pnp_sci.result": ("pnp_sci.results.result", "pnp_sci.results.history"),
    "pnp_sci.weights": ("pnp_sci.formats.weights",),
}


class _Finder(MetaPathFinder, Loader):
    def find_spec(self, fullname: str, path: Any, target: Any = None) -> ModuleSpec | None:
        return spec_from_loader(fullname, self) if fullname in MOVED else None

    def exec_module(self, module: ModuleType) -> None:
        places = MOVED[module.__name__]
        warnings.warn(f"{module.__name__} has moved to {' and '.join(places)}", DeprecationWarning, stacklevel=2)
        for place in places:
            names = vars(importlib.import_module(place)).items()
            vars(module).update({name: value for name, value in names if not name.startswith("__")})


sys.meta_path.append(_Finder())
