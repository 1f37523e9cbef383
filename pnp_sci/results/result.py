"""What a solver returns: the video, why it stopped, the course it took and what reproduces it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci.errors import InputError, SolverError
from pnp_sci.results import storage
from pnp_sci.results.export import PERCENTILE, White, as_dataset, export, parts, white_of
from pnp_sci.results.history import History, Record, Status

if TYPE_CHECKING:
    import xarray
    from matplotlib.figure import Figure


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
    scenes : list of dict
        What was found of the scene of each measurement, and what was modelled of it; see also :attr:`scene`.
    uncertainty : ndarray, like x, or None
        Predicted root mean square error of each pixel, in the units of x, where it was asked for. NaN where it is not
        known: the remarks say why.

    Examples
    --------
    >>> Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History([Record(7, 0.5, 0.01, 0.0)]), {})
    Result(2 views x 3 frames of 4 x 5, 7 iterations in 0.5 s: the iterates stopped changing; residual 0.01)
    """

    x: np.ndarray
    status: Status
    history: History
    settings: dict[str, Any]
    scenes: list[dict[str, Any]] = field(default_factory=list)
    uncertainty: np.ndarray | None = None

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
        white = float(np.percentile(self.x, PERCENTILE)) if peak is None else float(peak)
        return white if white > 0 else 1.0

    @property
    def scene(self) -> dict[str, Any]:
        """What was found of the scene of the only measurement, see `scenes`.

        Raises
        ------
        InputError
            If there are several measurements.
        """
        if len(self.scenes) > 1:
            raise InputError(f"scene: the result has {len(self.scenes)} measurements: scenes[n] was expected")
        return self.scenes[0] if self.scenes else {}

    @property
    def remarks(self) -> list[str]:
        """What to know before the result is used, a sentence each: parts not modelled, and faults of the measurement.

        They are the entries "remarks" of `scenes`; of several measurements it is said which they concern.
        """
        concerned: dict[str, list[int]] = {}
        for n, scene in enumerate(self.scenes):
            for remark in scene.get("remarks", []):
                concerned.setdefault(remark, []).append(n)
        count = len(self.scenes)
        return [text if len(ns) == count else f"measurement {_counted(ns)}: {text}" for text, ns in concerned.items()]

    def save(self, path: str | Path) -> None:
        """Write NPZ, HDF5 (.h5, .hdf5) or MAT, which :meth:`load` reads; the rest is JSON in it, never pickle.

        In MAT-files planes come last, (H, W, B, V), as in MATLAB.

        A write that is interrupted leaves nothing behind, and the file that was there before as it was.
        """
        storage.save(Path(path), self.x, self.status, self.history, self.settings, self.scenes, self.uncertainty)

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
        return cls(**storage.load(Path(path)))

    def plot(
        self, frames: Sequence[int] | None = None, reference: Any = None, uncertainty: bool = False, white: White = None
    ) -> Figure:
        """A picture of some frames of each view.

        White is :attr:`white`, or the largest value of the reference, or as for :meth:`export`. See
        :func:`pnp_sci.plot.plot_video` for the other parameters.
        """
        from pnp_sci.plot import plot_video

        errors = self.uncertainty if uncertainty else None
        if uncertainty and errors is None:
            raise InputError("uncertainty was not asked for: solve(..., uncertainty=True) predicts it")
        shown = None if reference is not None and white is None else white_of(self.x, white, self.white).ravel()
        return plot_video(self.x, frames, reference, shown, errors)

    def export(self, path: str | Path, fps: float = 10, white: White = None) -> None:
        """Write it for looking at, or as a stack of pictures with its values.

        Parameters
        ----------
        path : path
            MP4, AVI or GIF: a film of 8 bits, the views side by side. PNG: one picture of 8 bits, frames from left to
            right, views below each other. TIFF: float32, unscaled, for ImageJ: frames as times and views as channels.
            Several measurements follow one another, or lie below each other in a PNG.
        fps : float
            Frames per second of a film; in a TIFF it is noted.
        white : float, sequence of float, or "view"
            The value that is white in films and pictures: for all views, for each, or "view" for the 99.9th percentile
            of each view, so that dim views are seen. By default :attr:`white`.

        Raises
        ------
        FormatError
            If the suffix is another.
        InputError
            If `fps` or `white` cannot be used.
        """
        export(Path(path), self.x, white_of(self.x, white, self.white), fps)

    def to_xarray(self, fps: float | None = None) -> xarray.Dataset:
        """Labelled arrays: `x` and, where it is known, `uncertainty`; needs the extra ``xarray``.

        Dimensions are measurement (of several), view, frame, row and column. Status, remarks and, as JSON, settings are
        attributes. With `fps`, frames per second, the coordinate `time` has seconds since the first frame.
        """
        return as_dataset(self, fps)

    def __len__(self) -> int:
        return len(self.x) if self.x.ndim == 5 else 1

    def __getitem__(self, index: int | slice) -> Result:
        """The result of one of several measurements, or of some: its video, history, plan, scene and errors.

        A measurement of a sequence has the history and the plan of its window.
        """
        if self.x.ndim != 5:
            raise InputError(f"index is {index!r}, but the result is of one measurement alone")
        try:
            numbers = range(len(self.x))[index]
        except (IndexError, TypeError) as error:
            expected = f"a number from {-len(self.x)} to {len(self.x) - 1}, or a slice, was expected"
            raise InputError(f"index is {index!r}: {expected}") from error
        own = parts(self, numbers if isinstance(numbers, range) else [numbers])
        history = History(replace(record, measurement=k) for k, record in own["records"])
        errors = None if self.uncertainty is None else self.uncertainty[index]
        statuses = own["settings"].get("status")
        status = Status.worst(map(Status, statuses)) if statuses else self.status
        return Result(self.x[index], status, history, own["settings"], own["scenes"], errors)

    def __iter__(self) -> Iterator[Result]:
        return (self[n] for n in range(len(self)))

    def __repr__(self) -> str:
        line = f"Result({self._size()}, {self._effort()}: {self.status.value}{self._scores()})"
        return "\n".join([line, *(f"  {remark}" for remark in self.remarks)])

    def __str__(self) -> str:
        """The result in a line, and below it how it was obtained: each plan in words.

        There is one for each measurement, or for each window of a sequence.
        """
        plans, of = self.settings.get("plan", []), "window" if self.settings.get("sequence", 1) > 1 else "measurement"
        numbered = [f"  {of} {n + 1}: " if len(plans) > 1 else "  " for n in range(len(plans))]
        return "\n".join([repr(self), *(start + _in_words(plan) for start, plan in zip(numbered, plans))])

    def _repr_html_(self) -> str:
        """What a notebook shows: a table, a picture of some frames, and a player."""
        from pnp_sci.results.notebook import as_html

        rows = {"video": self._size(), "effort": self._effort(), "status": self.status.value}
        rows |= {key: str(self.settings[key]) for key in ("prior", "algorithm") if key in self.settings}
        rows |= {"scores": self._scores().removeprefix("; "), "remarks": "; ".join(self.remarks)}
        return as_html(rows, self.x, self.white)

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
        if self.uncertainty is not None and np.isfinite(self.uncertainty).any():
            texts.append(f"predicted error {np.sqrt(np.nanmean(np.square(self.uncertainty, dtype=np.float64))):.2g}")
        return "; " + ", ".join(texts) if texts else ""

    def _last_records(self) -> list[Record]:
        return list({record.measurement: record for record in self.history}.values())


def _counted(numbers: Sequence[int]) -> str:
    """``[0, 2]`` -> ``"1, 3"``; ten at most."""
    texts = [str(n + 1) for n in numbers[:10]]
    return ", ".join(texts) + (f" and {len(numbers) - 10} more" if len(numbers) > 10 else "")


def _in_words(plan: dict[str, Any]) -> str:
    """A plan as :meth:`pnp_sci.solvers.plan.Plan.describe` gives it, in a line."""
    ends = [*(turn["from"] for turn in plan["serves"][1:]), plan["iterations"]]
    turns = [f"{turn['name']} to iteration {end} at most" for turn, end in zip(plan["serves"], ends)]
    first, last = plan["sigma"]
    sigma = f"sigma {first:.3g}" if first == last else f"sigma falling from {first:.3g} to {last:.3g}"
    return f"{plan['algorithm']}: {', then '.join(turns)}; {sigma}, rho {plan['rho']:.3g}"
