"""Figures of videos and of the course of a run. They are made without pyplot: nothing global changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci.errors import InputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_SHOWN = 6  # frames side by side that are still large enough to judge
_PANEL = 1.9  # inches


def plot_video(
    x: Any, frames: Sequence[int] | None = None, reference: Any = None, white: float | None = None
) -> Figure:
    """Frames from left to right, a row for each view.

    Parameters
    ----------
    x : array_like, (B, H, W), (V, B, H, W) or (N, V, B, H, W)
    frames : sequence of int, optional
        Which to show, counted from 0. Default: at most 6, evenly spread.
    reference : array_like, same shape, optional
        Shown in a row below each view.
    white : float, optional
        The value shown as white; black is 0. Default: the largest of `reference`, or of `x` without one.

    Raises
    ------
    InputError
        If the shapes differ, or a frame is not there.

    Examples
    --------
    >>> figure = plot_video(np.ones((2, 10, 8, 8)), frames=[0, 9])
    >>> len(figure.axes)
    4
    """
    from matplotlib.figure import Figure

    x = _films("x", x)
    rows = [("", x)]
    if reference is not None:
        rows.append(("reference ", _films("reference", reference)))
        if rows[1][1].shape != x.shape:
            raise InputError(f"reference has shape {np.shape(reference)}, but x {x.shape}: the same was expected")
    views, count = x.shape[:2]
    chosen = np.linspace(0, count - 1, min(count, _SHOWN)).round().astype(int) if frames is None else np.array(frames)
    if chosen.size == 0 or chosen.min() < 0 or chosen.max() >= count:
        raise InputError(f"frames is {chosen.tolist()}: whole numbers from 0 to {count - 1} were expected")
    white = float(rows[-1][1].max()) if white is None else white
    height = _PANEL * x.shape[2] / x.shape[3]
    figure = Figure(figsize=(_PANEL * len(chosen), height * views * len(rows) + 0.3), layout="constrained")
    axes: Any = figure.subplots(views * len(rows), len(chosen), squeeze=False)
    for row, column in np.ndindex(axes.shape):
        view, (kind, films) = row // len(rows), rows[row % len(rows)]
        axis = axes[row, column]
        axis.imshow(films[view, chosen[column]], cmap="gray", vmin=0, vmax=white)
        axis.set(xticks=[], yticks=[])
        if row == 0:
            axis.set_title(f"frame {chosen[column] + 1}", fontsize=8)
        if column == 0:
            axis.set_ylabel(f"{kind}view {view + 1}", fontsize=8)
    return figure


def plot_history(result: Any) -> Figure:
    """Residual, noise level and, where a reference was given, PSNR over the iterations; a line per measurement."""
    from matplotlib.figure import Figure

    table = {name: result.history[name] for name in ("measurement", "iteration", "residual", "sigma", "psnr")}
    curves = ["residual", "sigma"] + ["psnr"] * bool(np.isfinite(table["psnr"]).any())
    figure = Figure(figsize=(3.4 * len(curves), 2.6), layout="constrained")
    axes: Any = figure.subplots(1, len(curves))
    for axis, name in zip(axes, curves):
        for measurement in np.unique(table["measurement"]):
            own = table["measurement"] == measurement
            axis.plot(table["iteration"][own], table[name][own])
        if name != "psnr" and (table[name] > 0).any():
            axis.set_yscale("log")
        axis.set(xlabel="iteration", ylabel="PSNR (dB)" if name == "psnr" else name)
    return figure


def _films(name: str, array: Any) -> np.ndarray:
    array = np.asarray(array)
    if array.ndim not in (3, 4, 5) or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}: (B, H, W), (V, B, H, W) or (N, V, B, H, W) was expected")
    return array[None] if array.ndim == 3 else array.reshape(-1, *array.shape[-3:])
