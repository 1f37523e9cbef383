"""What a solver hands back: the video, why it stopped, the course it took and what reproduces it."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields
from enum import Enum
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from pnp_sci import io
from pnp_sci.errors import FormatError, InputError, InputTypeError, SolverError
from pnp_sci.formats import arrays as _formats

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_WHITE_PERCENTILE = 99.9  # a few overshooting pixels do not darken the picture
_HDF5 = {".h5", ".hdf5"}


class Status(Enum):
    """Why a solver stopped, as a sentence; from the best to the worst."""

    CONVERGED = "the iterates stopped changing"
    DECODED = "a network decoded the measurement, without iterations"
    ITERATIONS = "the number of iterations was reached"
    TIME_BUDGET = "the time budget was spent"
    STOPPED = "the callback asked to stop"
    DIVERGED = "the residual grew: the best iterate before that is returned"
    NOT_FINITE = "an iterate was not finite: the last finite one is returned"

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
    """One iteration; the last one together with what solve has made of its estimate.

    Attributes
    ----------
    iteration : int
    seconds : float
        Since the solver began with this measurement.
    residual : float
        ``||y - Phi x|| / ||y||``; of saturated pixels only what Phi x falls short of y counts.
    sigma : float
        What the prior was told, in units where x spans about [0, 1].
    psnr, ssim : float or None
        Mean over the views, where a reference was given; SSIM only at the last iteration.
    measurement : int
        Which of several.
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
                raise InputError(f"index is {index!r}: one of {', '.join(self.names)} was expected")
            return self.table()[:, self.names.index(index)]
        return History(self._records[index]) if isinstance(index, slice) else self._records[index]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, History) and self._records == other._records

    def __hash__(self) -> int:
        return hash(self._records)

    def __repr__(self) -> str:
        return f"History({len(self)} records)"

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


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A reconstruction, with an honest record of how it was obtained.

    Attributes
    ----------
    x : ndarray, (V, B, H, W) or (N, V, B, H, W)
        In the units that y and the masks imply; N measurements give N videos.
    status : Status
        Why the solver stopped; of several measurements the worst.
    history : History
        Of all measurements, one after the other.
    settings : dict
        What reproduces it: options, versions, seed, hashes of the input. Holds what JSON can hold.
    scene : dict
        What was taken for granted about the scene.

    Examples
    --------
    >>> Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History([Record(7, 0.5, 0.01, 0.0)]), {})
    Result(2 views x 3 frames of 4 x 5, 7 iterations in 0.5 s: the iterates stopped changing; residual 0.01)
    """

    x: np.ndarray
    status: Status
    history: History
    settings: dict[str, Any]
    scene: dict[str, Any] = field(default_factory=dict)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        return np.array(self.x, dtype) if copy else np.asarray(self.x, dtype)

    def raise_for_status(self) -> None:
        """Raise a SolverError if the computation failed."""
        if not self.status.ok:
            raise SolverError(f"{self.status.value} ({self._effort()})")

    @property
    def white(self) -> float:
        """The value shown as white: ``settings["peak"]`` if there is one, else the 99.9th percentile of x."""
        peak = self.settings.get("peak")
        white = float(np.percentile(self.x, _WHITE_PERCENTILE)) if peak is None else float(peak)
        return white if white > 0 else 1.0

    def save(self, path: str | Path) -> None:
        """Write NPZ or HDF5 (.h5, .hdf5), which :meth:`load` reads; the rest is JSON in it, never pickle.

        A write that is interrupted leaves nothing behind, and the file that was there before as it was.
        """
        path = Path(path)
        _suffix_known(path)
        arrays = {"x": self.x, "history": self.history.table()}
        texts = {
            "status": self.status.value,
            "history_columns": json.dumps(History.names),
            "settings": json.dumps(self.settings, default=_as_json),
            "scene": json.dumps(self.scene, default=_as_json),
        }
        with io._replacing(path) as temporary:
            if path.suffix.lower() in _HDF5:
                import h5py

                with h5py.File(temporary, "w") as file:
                    for name, array in arrays.items():
                        file[name] = array
                    file.attrs.update(texts)
            else:
                with temporary.open("wb") as stream:
                    np.savez(stream, allow_pickle=False, **arrays, **texts)

    @classmethod
    def load(cls, path: str | Path) -> Result:
        """Read what :meth:`save` wrote.

        Raises
        ------
        FileNotFoundError
            If there is no such file.
        FormatError
            If it is damaged or not a result.
        """
        path = Path(path)
        _suffix_known(path)
        if not path.is_file():
            raise FileNotFoundError(f"{path}: there is no such file")
        try:
            parts = _read_hdf5(path) if path.suffix.lower() in _HDF5 else _read_npz(path)
            settings, scene = (json.loads(str(parts[name])) for name in ("settings", "scene"))
            history, x = History.from_table(parts["history"]), parts["x"]
            if (
                x.ndim not in (4, 5)
                or x.dtype.kind != "f"
                or not (isinstance(settings, dict) and isinstance(scene, dict))
            ):
                raise FormatError(
                    f"x is {x.dtype} {x.shape}, settings and scene are {settings!r:.40} and {scene!r:.40}"
                )
            return cls(x, Status(str(parts["status"])), history, settings, scene)
        except Exception as error:  # each library has its own exceptions for a damaged file
            reason = (str(error) or type(error).__name__).splitlines()[0]
            raise FormatError(f"{path} cannot be read as a result: {reason}") from error

    def plot(self, frames: Sequence[int] | None = None, reference: Any = None) -> Figure:
        """A picture of some frames of each view, white as :attr:`white` or as the largest value of the reference.

        See :func:`pnp_sci.plot.plot_video` for the parameters.
        """
        from pnp_sci.plot import plot_video

        return plot_video(self.x, frames, reference, self.white if reference is None else None)

    def export(self, path: str | Path, fps: float = 10) -> None:
        """Write it for looking at: values are divided by :attr:`white` and clipped to [0, 1].

        Parameters
        ----------
        path : path
            MP4, AVI or GIF: a film of 8 bits, the views side by side. TIFF: the same frames as a stack of float32.
            PNG: one picture of 8 bits, frames from left to right, views below each other. Several measurements follow
            one another, or lie below each other in a PNG.
        fps : float
            Frames per second of a film.

        Raises
        ------
        FormatError
            If the suffix is another.
        """
        path, (rows, columns) = Path(path), self.x.shape[-2:]
        shown = np.clip(self.x / self.white, 0, 1).astype(np.float32).reshape(-1, *self.x.shape[-4:])
        films = shown.transpose(0, 2, 3, 1, 4).reshape(-1, rows, shown.shape[1] * columns)
        suffix = path.suffix.lower()
        if suffix in _formats.VIDEO:
            io.write_video(path, films, fps)
        elif suffix in {".tif", ".tiff"}:
            io.write(path, films)
        elif suffix == ".png":
            io.write(path, shown.transpose(0, 1, 3, 2, 4).reshape(-1, shown.shape[2] * columns))
        else:
            known = ", ".join(sorted({*_formats.VIDEO, ".tif", ".tiff", ".png"}))
            raise FormatError(f"{path}: cannot export as {suffix or 'a file without suffix'}; known are {known}")

    def __repr__(self) -> str:
        return f"Result({self._size()}, {self._effort()}: {self.status.value}{self._scores()})"

    def _repr_html_(self) -> str:
        rows = {"video": self._size(), "effort": self._effort(), "status": self.status.value}
        rows |= {key: str(self.settings[key]) for key in ("prior", "algorithm") if key in self.settings}
        rows["scores"] = self._scores().removeprefix("; ")
        cells = "".join(f"<tr><th>{key}</th><td>{escape(text)}</td></tr>" for key, text in rows.items() if text)
        return f"<table>{cells}</table>"

    def _size(self) -> str:
        *several, views, frames, rows, columns = self.x.shape
        count = f"{several[0]} videos of " if several else ""
        return f"{count}{views} view{'s' * (views != 1)} x {frames} frames of {rows} x {columns}"

    def _effort(self) -> str:
        last = self._last_records()
        iterations = sum(record.iteration for record in last)
        seconds = sum(record.seconds for record in last)
        return f"{iterations} iteration{'s' * (iterations != 1)} in {seconds:.2g} s"

    def _scores(self) -> str:
        units = {"residual": " {:.2g}", "psnr": " {:.2f} dB", "ssim": " {:.3f}"}
        last, texts = self._last_records(), []
        for name, unit in units.items():
            values = [value for record in last if (value := getattr(record, name)) is not None]
            if values:
                texts.append((name if name == "residual" else name.upper()) + unit.format(np.mean(values)))
        return "; " + ", ".join(texts) if texts else ""

    def _last_records(self) -> list[Record]:
        return list({record.measurement: record for record in self.history}.values())


def _suffix_known(path: Path) -> None:
    if path.suffix.lower() not in {".npz", *_HDF5}:
        raise FormatError(f"{path}: a result is kept in .npz, .h5 or .hdf5, but {path.suffix or 'no suffix'} came")


def _as_json(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufU":
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise InputTypeError(f"settings or scene hold {value!r} of type {type(value).__name__}: JSON has no such thing")


def _read_npz(path: Path) -> Mapping[str, Any]:
    with path.open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        return dict(file)


def _read_hdf5(path: Path) -> Mapping[str, Any]:
    import h5py

    with h5py.File(path) as file:
        return {**file.attrs, "x": np.asarray(file["x"]), "history": np.asarray(file["history"])}
