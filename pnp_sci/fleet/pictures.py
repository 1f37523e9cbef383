"""Measurements one by one: those that can be solved, and what is wrong with the others."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import groupby
from typing import Any

import numpy as np

from pnp_sci.pipeline.provenance import digest
from pnp_sci.sensing.problem import check_bad, check_measurement

Picture = np.ndarray | str  # a measurement (H, W), or the error with which it cannot be read
NOTHING = "InputError: y is 0 everywhere: a part of its file may be missing"


def read_each(read: Callable[[int, int], np.ndarray], start: int, stop: int) -> list[Picture]:
    """Measurements `start` to `stop` - 1 of a source: all at once, or one by one if some are not readable."""
    try:
        return list(read(start, stop))
    except Exception:
        each: list[Picture] = []
    for n in range(start, stop):
        try:
            each.append(read(n, n + 1)[0])
        except Exception as error:  # each library has its own exceptions
            each.append(in_a_line(error))
    return each


def wrong_with(y: Picture, bad: Any) -> str | None:
    """Why a measurement cannot be solved; None if nothing is seen to be wrong with it."""
    if isinstance(y, str):
        return y
    try:
        check_measurement(y, check_bad(bad, y))
    except Exception as error:
        return in_a_line(error)
    return None if np.ma.filled(y, 0).any() else NOTHING


def in_a_line(error: BaseException) -> str:
    """An error as text.

    >>> in_a_line(ValueError("a"))
    'ValueError: a'
    """
    return " ".join(f"{type(error).__name__}: {error}".split())


def digest_of_all(each: Sequence[Picture]) -> str:
    """SHA-256 of measurements and of what is masked in them; all that cannot be read are the same."""
    whole = hashlib.sha256()
    for y in each:
        if isinstance(y, np.ndarray):
            masked = digest(np.ma.getmaskarray(y)) if np.ma.is_masked(y) else ""
            whole.update(f"{digest(y)} {masked};".encode())
        else:
            whole.update(b"unread;")
    return whole.hexdigest()


def stacked(pictures: Sequence[Any]) -> np.ndarray:
    """Measurements (n, H, W), masked if one of them is."""
    return np.ma.stack(pictures) if any(map(np.ma.isMaskedArray, pictures)) else np.stack(pictures)


def runs(numbers: Iterable[int]) -> Iterator[range]:
    """Numbers in ascending order, as ranges.

    >>> list(runs([1, 2, 3, 7]))
    [range(1, 4), range(7, 8)]
    """
    for _, pairs in groupby(enumerate(numbers), lambda pair: pair[1] - pair[0]):
        run = [number for _, number in pairs]
        yield range(run[0], run[-1] + 1)
