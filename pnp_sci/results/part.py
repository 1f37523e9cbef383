"""The result of some of several measurements."""

from __future__ import annotations

from bisect import bisect
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, SupportsIndex

from pnp_sci.errors import InputError, InputIndexError
from pnp_sci.results.history import History, Status

EACH = "noise", "unit"  # settings that are a list, one entry a measurement
SOLVED = "share", "plan", "statuses"  # ... one entry for each that was solved alone, or for each window of a sequence


def chosen_by(index: SupportsIndex | slice, count: int) -> Sequence[int]:
    """The numbers of the measurements that an index of `count` of them stands for.

    >>> chosen_by(-1, 3), list(chosen_by(slice(1, None), 3))
    ([2], [1, 2])
    """
    if isinstance(index, slice):
        if not (several := range(count)[index]):
            raise InputError(f"index is {index}: at least one of {count} measurements was expected")
        return several
    try:
        return [range(count)[index]]
    except IndexError:
        expected = f"a whole number from {-count} to {count - 1} was expected, as there are {count} measurements"
        raise InputIndexError(f"index is {index}: {expected}") from None


def part(fields: Mapping[str, Any], count: int, chosen: Sequence[int], alone: bool) -> dict[str, Any]:
    """The fields of a result of the `chosen` ones of `count` measurements; without their axis if one is `alone`.

    A measurement of a sequence has the history and the plan of its window.
    """
    x, errors, settings = fields["x"], fields["uncertainty"], dict(fields["settings"])
    begins = sorted({record.measurement for record in fields["history"]})  # of what was solved together
    window = [bisect(begins, n) - 1 for n in chosen]
    solved = {k: window.index(k) for k in window if k >= 0}  # the place among the chosen
    for keys, places in ((EACH, chosen), (SOLVED, list(solved))):
        for key in keys:
            if isinstance(settings.get(key), list):  # of plans there are fewer, if a callback has stopped the solver
                settings[key] = [settings[key][n] for n in places if n < len(settings[key])]
    settings["measurements"] = [settings.get("measurements", range(count))[n] for n in chosen]
    statuses = [Status[name] for name in settings.get("statuses", [])]
    records = [
        replace(record, measurement=place)
        for k, place in solved.items()
        for record in fields["history"]
        if record.measurement == begins[k]
    ]
    take = chosen[0] if alone else list(chosen)
    return {
        "x": x[take],
        "status": Status.worst(statuses) if statuses else fields["status"],
        "history": History(records),
        "settings": settings,
        "scenes": [fields["scenes"][n] for n in chosen if n < len(fields["scenes"])],
        "uncertainty": None if errors is None else errors[take],
    }
