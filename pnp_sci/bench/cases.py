"""The scenes to measure on, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import partial

from .. import datasets
from ..errors import InputError

_CASES: dict[str, Callable[[], datasets.Scene]] = {
    "embedded": datasets.embedded_scene,
    **{pair: partial(datasets.dualview, pair) for pair in datasets.DUAL_VIEW_PAIRS},
    **{name: partial(datasets.singleview, name) for name in (*datasets.SINGLE_VIEW, "kobe")},
    **{name: partial(datasets.real, name) for name in datasets.REAL},
    "wheel+hand": datasets.real_dual,
}
_GROUPS: dict[str, tuple[str, ...]] = {
    "dualview": datasets.DUAL_VIEW_PAIRS,
    "singleview": (*datasets.SINGLE_VIEW, "kobe"),
    "real": (*datasets.REAL, "wheel+hand"),
}


def expand(names: Iterable[str]) -> list[str]:
    """Names of cases, with groups (``dualview``, ``singleview``, ``real``) replaced by their members.

    Raises
    ------
    InputError
        If there is no such case or group.

    Examples
    --------
    >>> expand(["embedded", "real"])
    ['embedded', 'wheel', 'hand', 'wheel+hand']
    """
    members = {name: _GROUPS.get(name, (name,)) for name in names}
    for name in members:
        if name not in _CASES and name not in _GROUPS:
            raise InputError(f"case is {name!r}: one of {', '.join((*_CASES, *_GROUPS))} was expected")
    return list(dict.fromkeys(member for group in members.values() for member in group))


def load(name: str) -> datasets.Scene:
    """The scene of a case; as :func:`pnp_sci.datasets.fetch` where its files are not here."""
    (name,) = expand([name])
    return _CASES[name]()
