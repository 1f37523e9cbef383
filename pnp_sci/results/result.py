"""What a solver returns: the video, why it stopped, the course it took and what reproduces it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex

import numpy as np

from pnp_sci import io
from pnp_sci._validate import positive_number
from pnp_sci.errors import FormatError, InputError, InputIndexError, SolverError
from pnp_sci.formats import arrays as _formats
from pnp_sci.formats import films_as_tiff
from pnp_sci.formats.brightness import brightest, of_views, whites
from pnp_sci.formats.pictures import save_png
from pnp_sci.formats.replacing import replacing
from pnp_sci.results import storage
from pnp_sci.results.channels import as_channels
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.words import counted, in_words

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

    from pnp_sci.results.notebook import Shown


@dataclass(frozen=True, eq=False, repr=False)
class Result:
    """A reconstruction, with an honest record of how it was obtained.

    Attributes
    ----------
    x : ndarray, (V, B, H, W) or (N, V, B, H, W)
        In the units that y and the masks imply; N measurements give N videos. Those of mosaics have a last axis of 3
        colours: ``settings["mosaic"]`` says so.
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

    def __len__(self) -> int:
        """The number of measurements."""
        return len(self.videos)

    def __getitem__(self, index: SupportsIndex | slice) -> Result:
        """The result of one measurement, or of some: video, history, scenes, plans and uncertainty of those alone.

        Hashes and seconds in `settings` are of the whole call; ``settings["measurements"]`` says which of it these are.

        Raises
        ------
        InputIndexError
            If there is no such measurement; it is an InputError and an IndexError.
        InputError
            If a slice is empty.

        Examples
        --------
        >>> both = Result(np.ones((2, 1, 3, 4, 5)), Status.CONVERGED, History(), {})
        >>> len(both), both[-1].x.shape, both[:1].x.shape
        (2, (1, 3, 4, 5), (1, 1, 3, 4, 5))
        """
        from pnp_sci.results.part import part

        count = len(self)
        if isinstance(index, slice):
            chosen = range(count)[index]
            if not chosen:
                raise InputError(f"index is {index}: at least one of {count} measurements was expected")
        else:
            try:
                chosen = [range(count)[index]]
            except IndexError:
                expected = (
                    f"a whole number from {-count} to {count - 1} was expected, as there are {count} measurements"
                )
                raise InputIndexError(f"index is {index}: {expected}") from None
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if not self._several:
            fields |= {name: None if (a := fields[name]) is None else a[None] for name in ("x", "uncertainty")}
        return Result(**part(fields, count, chosen, not isinstance(index, slice)))

    def raise_for_status(self) -> None:
        """Raise a SolverError if the computation failed."""
        if not self.status.ok:
            raise SolverError(f"{self.status.value} ({self._effort()})")

    @property
    def white(self) -> float:
        """The value shown as white: ``settings["peak"]`` if there is one, else the 99.9th percentile of x."""
        peak = self.settings.get("peak")
        return float(peak) if peak else brightest(self.x)

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
        return [text if len(ns) == count else f"measurement {counted(ns)}: {text}" for text, ns in concerned.items()]

    @property
    def videos(self) -> np.ndarray:
        """The videos of all measurements, (N, V, B, H, W), in colour (N, V, B, H, W, 3)."""
        return self.x if self._several else self.x[None]

    @property
    def in_colour(self) -> bool:
        """Whether the last axis of the videos is red, green and blue: ``settings["mosaic"]`` says so."""
        return bool(self.settings.get("mosaic"))

    @property
    def _several(self) -> bool:
        return self.x.ndim == 5 + self.in_colour

    def save(self, path: str | Path) -> None:
        """Write NPZ, HDF5 (.h5, .hdf5), MAT or Zarr, which :meth:`load` reads; the rest is JSON in it, never pickle.

        In a MAT-file planes come last: x is (H, W, B, V) or (H, W, B, V, N), in colour (H, W, 3, B, V). A Zarr store
        has the image "video" with axes (t, c, y, x), frames and views, in colour red, green and blue of each, as
        OME-Zarr 0.5 wants it, and a chunk for each measurement and channel.

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

    def to_xarray(self, fps: float | None = None) -> Dataset:
        """A data set of xarray with the axes (measurement, view, frame, y, x); it needs the extra ``xarray``.

        Parameters
        ----------
        fps : float, optional
            Frames per second: `time` in seconds becomes a coordinate of the frames.

        Returns
        -------
        xarray.Dataset
            Variables `video`, `history` and, where it is known, `uncertainty`; `status`, `settings`, `scenes` and
            `remarks` are attributes, the last three as JSON.

        Examples
        --------
        >>> result = Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History(), {})
        >>> result.to_xarray(fps=10).video.sel(view=1, frame=2).shape
        (1, 4, 5)
        """
        from pnp_sci.results.labelled import labelled

        return labelled(self, fps)

    def plot(
        self, frames: Sequence[int] | None = None, reference: Any = None, uncertainty: bool = False, white: Any = None
    ) -> Figure:
        """A picture of some frames of each view, white as :attr:`white` or as the largest value of the reference.

        See :func:`pnp_sci.plot.plot_video` for the parameters.
        """
        from pnp_sci.plot import plot_video

        errors = self.uncertainty if uncertainty else None
        if uncertainty and errors is None:
            raise InputError("uncertainty was not asked for: solve(..., uncertainty=True) predicts it")
        white = self.white if reference is None and white is None else white
        return plot_video(self.x, frames, reference, white, errors, colour=self.in_colour)

    def show(self, white: Any = None) -> Shown:
        """What a notebook shows of a result, with another white: a number, one a view, or "view" (see :meth:`export`).

        Examples
        --------
        >>> shown = Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History(), {}).show(white="view")
        >>> shown._repr_html_().startswith("<table>")
        True
        """
        from pnp_sci.results.notebook import Shown, as_html

        rows = {"video": self._size(), "effort": self._effort(), "status": self.status.value}
        rows |= {key: str(self.settings[key]) for key in ("prior", "algorithm") if key in self.settings}
        rows |= {"scores": self._scores().removeprefix("; "), "remarks": "; ".join(self.remarks)}
        return Shown(as_html(rows, self.videos[0], whites(white, self.videos, self.white)))

    def export(self, path: str | Path, fps: float = 10, white: Any = None) -> None:
        """Write it for looking at, or as TIFF with its values.

        Parameters
        ----------
        path : path
            MP4, AVI or GIF: a film of 8 bits, the views side by side. PNG: one picture of 8 bits, frames from left to
            right, views below each other. TIFF: the values as float32 and unscaled, frames as T and views as channels,
            or red, green and blue of each view, for ImageJ, or with OME-XML as ``.ome.tif``. Several measurements
            follow one another, or lie below each other in a PNG.
        fps : float
            Frames per second of a film, or in the metadata of a TIFF.
        white : float, sequence of V floats, or "view", optional
            What is white: one value, one a view, or the 99.9th percentile of each view. Default: :attr:`white`.
            Pictures are divided by it and clipped to [0, 1]; a TIFF has it as metadata only.

        Raises
        ------
        FormatError
            If the suffix is another.
        InputError
            If `fps` or `white` cannot be used.
        """
        path, x = Path(path), self.videos
        levels, fps, suffix = whites(white, x, self.white), positive_number("fps", fps), path.suffix.lower()
        count, views, frames, rows, columns, *colours = x.shape
        if suffix in films_as_tiff.SUFFIXES:
            stack = as_channels(x) if colours else x
            with replacing(path) as temporary:
                levels = np.repeat(levels, stack.shape[1] // views)
                films_as_tiff.save(temporary, stack, fps, levels, films_as_tiff.is_ome(path), bool(colours))
            return
        shown = np.clip(x / of_views(levels, x[0]), 0, 1).astype(np.float32)
        if suffix in _formats.VIDEO:
            beside = np.moveaxis(shown, 1, 3).reshape(count * frames, rows, views * columns, *colours)
            io.write_video(path, beside, fps)
        elif suffix == ".png":
            beside = np.moveaxis(shown, 2, 3).reshape(count * views * rows, frames * columns, *colours)
            with replacing(path) as temporary:
                save_png(temporary, beside, bool(colours))
        else:
            known = ", ".join(sorted({*_formats.VIDEO, *films_as_tiff.SUFFIXES, ".png"}))
            raise FormatError(f"{path}: cannot export as {suffix or 'a file without suffix'}; known are {known}")

    def __repr__(self) -> str:
        line = f"Result({self._size()}, {self._effort()}: {self.status.value}{self._scores()})"
        return "\n".join([line, *(f"  {remark}" for remark in self.remarks)])

    def __str__(self) -> str:
        """The result in a line, and below it how it was obtained: each plan in words.

        There is one for each measurement, or for each window of a sequence.
        """
        plans, of = self.settings.get("plan", []), "window" if self.settings.get("sequence", 1) > 1 else "measurement"
        numbered = [f"  {of} {n + 1}: " if len(plans) > 1 else "  " for n in range(len(plans))]
        return "\n".join([repr(self), *(start + in_words(plan) for start, plan in zip(numbered, plans))])

    def _repr_html_(self) -> str:
        """What a notebook shows: a table, a picture of some frames, and a player."""
        return self.show()._repr_html_()

    def _size(self) -> str:
        count, views, frames, rows, columns, *colours = self.videos.shape
        videos = f"{count} videos of " if self._several else ""
        colour = " in colour" * bool(colours)
        return f"{videos}{views} view{'s' * (views != 1)} x {frames} frames of {rows} x {columns}{colour}"

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
