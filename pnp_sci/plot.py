"""Figures of videos and of the course of a run; notebooks show them.

They are made without pyplot: nothing global changes. They need the extra ``plot``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci._validate import shown
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.formats.brightness import whites

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 6  # frames side by side that are still large enough to judge
_PANEL = 1.9  # inches


def plot_video(
    x: Any,
    frames: Sequence[int] | None = None,
    reference: Any = None,
    white: Any = None,
    uncertainty: Any = None,
    *,
    colour: bool = False,
) -> Figure:
    """Frames from left to right, a row for each view.

    Parameters
    ----------
    x : array_like, (B, H, W), (V, B, H, W) or (N, V, B, H, W)
        With another axis of 3 at the end if it is in colour.
    frames : sequence of int, optional
        Which to show, counted from 0. Default: at most 6, evenly spread.
    reference : array_like, same shape, optional
        Shown in a row below each view.
    white : float, sequence of float, or "view", optional
        The value shown as white, or one for each view; black is 0. "view": the 99.9th percentile of each view. Default:
        the largest of `reference`, or of `x` without one.
    uncertainty : array_like, same shape, optional
        The predicted error of each pixel, in a row below each view; white is the largest.
    colour : bool
        Whether the last axis of the videos is red, green and blue.

    Raises
    ------
    InputError
        If the shapes differ, a frame is not there, or `white` cannot be used.

    Examples
    --------
    >>> figure = plot_video(np.ones((2, 10, 8, 8)), frames=[0, 9])
    >>> len(figure.axes)
    4
    """
    x = _films("x", videos := np.asarray(x), colour)
    rows = [("", x)]
    for name, other in (("reference", reference), ("uncertainty", uncertainty)):
        if other is None:
            continue
        rows.append((f"{name} ", _films(name, other, colour)))
        if rows[-1][1].shape != x.shape:
            raise InputError(f"{name} has shape {np.shape(other)}, but x {x.shape}: the same was expected")
    views, count = x.shape[:2]
    chosen = _chosen(frames, count, _SHOWN)
    largest = float((x if reference is None else rows[1][1]).max())
    videos = videos if videos.ndim == 5 + colour else x[None]
    levels = np.full(videos.shape[1], largest) if white is None else whites(white, videos)
    height = _PANEL * x.shape[2] / x.shape[3]
    size = _PANEL * len(chosen), height * views * len(rows) + 0.3
    figure = _figure()(figsize=size, layout="constrained")
    axes: Any = figure.subplots(views * len(rows), len(chosen), squeeze=False)
    for row, column in np.ndindex(axes.shape):
        view, (kind, films) = row // len(rows), rows[row % len(rows)]
        axis = axes[row, column]
        largest = float(np.nan_to_num(films).max()) if "uncertainty" in kind else float(levels[view % len(levels)])
        _show(axis, films[view, chosen[column]], largest)
        if row == 0:
            axis.set_title(f"frame {chosen[column] + 1}", fontsize=8)
        if column == 0:
            axis.set_ylabel(f"{kind}view {view + 1}", fontsize=8)
    return figure


def plot_recovery(
    y: Any,
    x: Any,
    reference: Any,
    frames: Sequence[int] | None = None,
    captions: Sequence[str] = (),
    white: Any = None,
) -> Figure:
    """A measurement, the videos recovered from it, and the truth, side by side; a row for each view.

    Parameters
    ----------
    y : array_like, (H, W)
        Shown from 0 to its largest value.
    x, reference : array_like, (V, B, H, W)
    frames : sequence of int, optional
        Which to show, counted from 0. Default: the first and the last one.
    captions : sequence of str, optional
        A text for each view, such as its PSNR.
    white : float, sequence of float, or "view", optional
        As for :func:`plot_video`. Default: the largest value of `reference`.

    Raises
    ------
    InputError
        If the shapes do not fit, or a frame is not there.

    Examples
    --------
    >>> video = np.ones((2, 10, 8, 8))
    >>> figure = plot_recovery(video.sum((0, 1)), video, video, captions=["38 dB", "37 dB"])
    >>> len(figure.axes)
    9
    """
    y, x, truth = np.asarray(y), _films("x", x), _films("reference", reference)
    if truth.shape != x.shape or y.shape != x.shape[2:]:
        raise InputError(
            f"x has shape {x.shape}, reference {truth.shape}, y {y.shape}: (V, B, H, W) twice and (H, W) were expected"
        )
    views, count, rows, columns = x.shape
    levels = whites(white, x[None], float(truth.max()) or 1.0)
    chosen = _chosen(frames, count, 2)
    size = _PANEL * (views + 2 * len(chosen)), _PANEL * rows / columns * views + 0.3
    figure = _figure()(figsize=size, layout="constrained")
    grid = figure.add_gridspec(views, views + 2 * len(chosen))
    axis = figure.add_subplot(grid[:, :views])
    _show(axis, y, float(y.max()))
    axis.set_title(f"measurement of {views} x {count} frames", fontsize=8)
    panels = [(name, films, frame) for frame in chosen for name, films in (("result", x), ("truth", truth))]
    for view, column in np.ndindex(views, len(panels)):
        name, films, frame = panels[column]
        axis = figure.add_subplot(grid[view, views + column])
        _show(axis, films[view, frame], float(levels[view]))
        if view == 0:
            axis.set_title(f"{name}, frame {frame + 1}", fontsize=8)
        if column == 0:
            axis.set_ylabel(", ".join([f"view {view + 1}", *captions[view : view + 1]]), fontsize=8)
    return figure


def plot_history(result: Any) -> Figure:
    """Residual, noise level and, where a reference was given, PSNR over the iterations; a line per measurement.

    Parameters
    ----------
    result : Result

    Raises
    ------
    InputTypeError
        If it has no history.
    """
    if not hasattr(result, "history"):
        raise InputTypeError(f"result is {shown(result)}: a Result was expected")
    table = {name: result.history[name] for name in ("measurement", "iteration", "residual", "sigma", "psnr")}
    curves = ["residual", "sigma"] + ["psnr"] * bool(np.isfinite(table["psnr"]).any())
    figure = _figure()(figsize=(3.4 * len(curves), 2.6), layout="constrained")
    axes: Any = figure.subplots(1, len(curves))
    for axis, name in zip(axes, curves):
        for measurement in np.unique(table["measurement"]):
            own = table["measurement"] == measurement
            axis.plot(table["iteration"][own], table[name][own])
        if name != "psnr" and (table[name] > 0).any():
            axis.set_yscale("log")
        axis.set(xlabel="iteration", ylabel="PSNR (dB)" if name == "psnr" else name)
    return figure


@cache
def _figure() -> type[Figure]:
    """The figures of matplotlib, with a picture of themselves for notebooks."""
    with needed_for("a figure", "plot"):
        from matplotlib.figure import Figure

    class ShownFigure(Figure):
        def _repr_png_(self) -> bytes:
            file = BytesIO()
            self.savefig(file, format="png")
            return file.getvalue()

    return ShownFigure


def _chosen(frames: Sequence[int] | None, count: int, most: int) -> np.ndarray:
    """The frames to show of so many, by default at most `most` of them."""
    if frames is None:
        return np.linspace(0, count - 1, min(count, most)).round().astype(int)
    chosen = np.array(frames)
    if (
        chosen.ndim != 1
        or chosen.dtype.kind not in "iu"
        or not chosen.size
        or not 0 <= chosen.min() <= chosen.max() < count
    ):
        expected = f"a list of whole numbers from 0 to {count - 1} was expected"
        raise InputError(f"frames is {shown(frames)}: {expected}")
    return chosen


def _show(axis: Any, picture: np.ndarray, white: float) -> None:
    picture = np.clip(picture / (white or 1.0), 0, 1) if picture.ndim == 3 else picture
    axis.imshow(picture, cmap="gray", vmin=0, vmax=white)
    axis.set(xticks=[], yticks=[])


def _films(name: str, array: Any, colour: bool = False) -> np.ndarray:
    """All views as (K, B, H, W) or (K, B, H, W, 3)."""
    array = np.asarray(array)
    film = array.shape[-4:] if colour else array.shape[-3:]
    if not 0 <= array.ndim - len(film) <= 2 or len(film) != 3 + colour or (colour and film[-1] != 3) or not array.size:
        last = " with a last axis of 3 colours" * colour
        expected = f"(B, H, W), (V, B, H, W) or (N, V, B, H, W){last} was expected"
        raise InputError(f"{name} has shape {array.shape}: {expected}")
    return array.reshape(-1, *film)
