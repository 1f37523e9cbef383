"""What a solver returns: the video, why it stopped, the course it took and what reproduces it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, SupportsIndex

from pnp_sci._validate import positive_number
from pnp_sci.errors import InputError, SolverError
from pnp_sci.formats.brightness import whites
from pnp_sci.results import storage, words
from pnp_sci.results.export import export
from pnp_sci.results.fields import Fields
from pnp_sci.results.part import chosen_by, part

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from xarray import Dataset

    from pnp_sci.results.notebook import Shown


@dataclass(frozen=True, eq=False, repr=False)
class Result(Fields):
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
    >>> import numpy as np
    >>> from pnp_sci import History, Record, Result, Status
    >>> Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History([Record(7, 0.5, 0.01, 0.0)]), {})
    Result(2 views x 3 frames of 4 x 5, 7 iterations in 0.5 s: the iterates stopped changing; residual 0.01)
    """

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
        >>> import numpy as np
        >>> from pnp_sci import History, Result, Status
        >>> both = Result(np.ones((2, 1, 3, 4, 5)), Status.CONVERGED, History(), {})
        >>> len(both), both[-1].x.shape, both[:1].x.shape
        (2, (1, 3, 4, 5), (1, 1, 3, 4, 5))
        """
        count = len(self)
        chosen = chosen_by(index, count)
        fields = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if not self._several:
            fields |= {name: None if (a := fields[name]) is None else a[None] for name in ("x", "uncertainty")}
        return Result(**part(fields, count, chosen, not isinstance(index, slice)))

    def raise_for_status(self) -> None:
        """Raise a SolverError if the computation failed."""
        if not self.status.ok:
            raise SolverError(f"{self.status.value} ({words.effort(self.history)})")

    def save(self, path: str | Path) -> None:
        """Write NPZ, HDF5 (.h5, .hdf5), MAT or Zarr, which :meth:`load` reads; the rest is JSON in it, never pickle.

        In a MAT-file planes come last: x is (H, W, B, V) or (H, W, B, V, N), in colour (H, W, 3, B, V). A Zarr store
        has the image "video" with axes (t, c, y, x), frames and views, in colour red, green and blue of each, as
        OME-Zarr 0.5 wants it, and a chunk for each measurement and channel.

        The file that was there before stays as it was until the new one is complete. A write that an exception ends,
        as Ctrl-C does, leaves nothing behind. A process that is killed may leave a temporary file, whose name begins
        with a dot: so does SIGTERM, unless it is made an exception, as ``pnp-sci`` does.
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
        >>> import numpy as np
        >>> from pnp_sci import History, Result, Status
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
        >>> import numpy as np
        >>> from pnp_sci import History, Result, Status
        >>> shown = Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History(), {}).show(white="view")
        >>> shown._repr_html_().startswith("<table>")
        True
        """
        from pnp_sci.results.notebook import Shown, as_html

        rows = {"video": self._size(), "effort": words.effort(self.history), "status": self.status.value}
        rows |= {key: str(self.settings[key]) for key in ("prior", "algorithm") if key in self.settings}
        rows |= {"scores": words.scores(self.history, self.uncertainty), "remarks": "; ".join(self.remarks)}
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
            If `fps` or `white` cannot be used, or a TIFF cannot hold such large or small values.
        """
        levels, fps = whites(white, self.videos, self.white), positive_number("fps", fps)
        export(Path(path), self.videos, levels, fps)

    def __repr__(self) -> str:
        scores = words.scores(self.history, self.uncertainty)
        line = f"Result({self._size()}, {words.effort(self.history)}: {self.status.value}{'; ' * bool(scores)}{scores})"
        return "\n".join([line, *(f"  {remark}" for remark in self.remarks)])

    def __str__(self) -> str:
        """The result in a line, and below it how it was obtained: each plan in words.

        There is one for each measurement, or for each window of a sequence.
        """
        return "\n".join([repr(self), *(f"  {plan}" for plan in words.plans(self.settings))])

    def _repr_html_(self) -> str:
        """What a notebook shows: a table, a picture of some frames, and a player."""
        return self.show()._repr_html_()

    def _size(self) -> str:
        return words.size(self.videos, self._several)
