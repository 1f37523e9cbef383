"""The course of a run: why it stopped, and a record of every iteration."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import astuple, dataclass, fields
from enum import Enum
from html import escape
from typing import overload

import numpy as np

from pnp_sci._validate import shown
from pnp_sci.errors import InputError


class Status(Enum):
    """Why a solver stopped, as a sentence; from the best to the worst.

    Examples
    --------
    >>> Status.TIME_BUDGET.value, Status.TIME_BUDGET.ok
    ('the time budget was spent', True)
    """

    CONVERGED = "the iterates stopped changing"
    DECODED = "a network decoded the measurement, without iterations"
    ITERATIONS = "the number of iterations was reached"
    TIME_BUDGET = "the time budget was spent"
    STOPPED = "the callback asked to stop"
    DIVERGED = "the estimate or its residual grew: the last one with the smallest residual, up to noise, is returned"
    NOT_FINITE = "an estimate was not finite: the best one before is returned, or zeros if there is none"

    @property
    def ok(self) -> bool:
        """Whether the computation went as it should."""
        return self not in (Status.DIVERGED, Status.NOT_FINITE)

    @staticmethod
    def worst(statuses: Iterable[Status]) -> Status:
        """The one to report for several measurements.

        >>> Status.worst([Status.DIVERGED, Status.CONVERGED]).name
        'DIVERGED'
        """
        return max(statuses, key=list(Status).index)


@dataclass(frozen=True)
class Record:
    """One iteration; the last record is of the estimate that is returned.

    Attributes
    ----------
    iteration : int
    seconds : float
        Since the first iteration; scene model and first estimate are not included.
    residual : float
        ``||y - Phi x|| / ||y||``; of saturated pixels only what Phi x falls short of y counts.
    sigma : float
        What the prior was told, in units where x spans about [0, 1].
    psnr, ssim : float or None
        Mean over the views, where a reference was given; SSIM only at the last iteration.
    measurement : int
        Which of several; of those of a sequence the first of its window.
    """

    iteration: int
    seconds: float
    residual: float
    sigma: float
    psnr: float | None = None
    ssim: float | None = None
    measurement: int = 0


class History(Sequence[Record]):
    """The records of a run in order; never changes.

    Examples
    --------
    >>> history = History([Record(1, 0.1, 0.5, 0.2), Record(2, 0.2, 0.25, 0.1)])
    >>> history[-1].residual, history["residual"]
    (0.25, array([0.5 , 0.25]))
    """

    names = tuple(f.name for f in fields(Record))

    def __init__(self, records: Iterable[Record] = ()):
        self._records = tuple(records)

    def __len__(self) -> int:
        return len(self._records)

    @overload
    def __getitem__(self, index: int) -> Record: ...
    @overload
    def __getitem__(self, index: slice) -> History: ...
    @overload
    def __getitem__(self, index: str) -> np.ndarray: ...
    def __getitem__(self, index: int | slice | str) -> Record | History | np.ndarray:
        """One record, a part of the history, or the values of one field (None is NaN)."""
        if isinstance(index, str):
            if index not in self.names:
                raise InputError(f"index is {shown(index)}: one of {', '.join(self.names)} was expected")
            return self.table()[:, self.names.index(index)]
        return History(self._records[index]) if isinstance(index, slice) else self._records[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, History) and self._records == other._records

    def __hash__(self) -> int:
        return hash(self._records)

    def __repr__(self) -> str:
        return f"History({len(self)} records)"

    def _repr_html_(self) -> str:
        """A table for notebooks, of at most twenty records, evenly spread."""
        shown = [self[int(k)] for k in np.unique(np.linspace(0, len(self) - 1, min(len(self), 20)).round())]
        cells = [[_cell(value) for value in astuple(record)] for record in shown]
        head = "".join(f"<th>{escape(name)}</th>" for name in self.names)
        body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells)
        return f"<table><tr>{head}</tr>{body}</table>"

    def table(self) -> np.ndarray:
        """All numbers, (records, fields) of float64 with NaN for None; the columns are :attr:`names`."""
        return np.array([astuple(record) for record in self], np.float64).reshape(len(self), len(self.names))

    @classmethod
    def from_table(cls, table: np.ndarray) -> History:
        """The history that :meth:`table` shows."""
        rows = [dict(zip(cls.names, row)) for row in np.asarray(table, np.float64).tolist()]
        whole, optional = ("iteration", "measurement"), ("psnr", "ssim")
        for row in rows:
            row.update({name: int(row[name]) for name in whole})
            row.update({name: None for name in optional if np.isnan(row[name])})
        return cls(Record(**row) for row in rows)


def _cell(value: float | int | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else f"{value:.4g}"
