"""Results for looking at, and for other programs: films, pictures, stacks and labelled arrays."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci import io
from pnp_sci._optional import needed_for
from pnp_sci._validate import positive_number
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats import arrays as _formats
from pnp_sci.formats.pictures import save_tiff
from pnp_sci.formats.replacing import replacing

if TYPE_CHECKING:
    import xarray

    from pnp_sci.results.result import Result

PERCENTILE = 99.9  # of the values: a few overshooting pixels do not darken the picture
STACKS = {".tif", ".tiff"}

White = float | Sequence[float] | str | None


def white_of(x: np.ndarray, white: White, default: float) -> np.ndarray:
    """The value shown as white in each view of x (..., V, B, H, W), as (V, 1, 1, 1).

    `white` is one number, one for each view, or "view": the 99.9th percentile of each view; None is the `default`.
    """
    views = x.shape[-4]
    if isinstance(white, str):
        if white != "view":
            raise InputError(f'white is {white!r}: "view", a number, or one for each view, was expected')
        found = np.percentile(np.moveaxis(x, -4, 0).reshape(views, -1), PERCENTILE, axis=1)
        found = np.where(found > 0, found, 1.0)
    else:
        given = np.atleast_1d(np.asarray(default if white is None else white, np.float64))
        if given.ndim != 1 or len(given) not in (1, views):
            raise InputError(f"white is {white!r}: one number, or {views}, one for each view, was expected")
        found = np.broadcast_to([positive_number("white", float(value)) for value in given], views)
    return found.reshape(views, 1, 1, 1)


def export(path: Path, x: np.ndarray, white: np.ndarray, fps: float) -> None:
    """Write a video x (..., V, B, H, W): a TIFF as it is, everything else divided by `white` (V, 1, 1, 1)."""
    videos, suffix = x.reshape(-1, *x.shape[-4:]), path.suffix.lower()
    if suffix in STACKS:
        positive_number("fps", fps)
        stack = np.concatenate(videos, axis=1).astype(np.float32, copy=False)
        with replacing(path) as temporary:
            save_tiff(temporary, stack, fps=fps)
        return
    shown = np.clip(videos / white, 0, 1).astype(np.float32)
    if suffix in _formats.VIDEO:
        rows, columns = x.shape[-2:]
        io.write_video(path, shown.transpose(0, 2, 3, 1, 4).reshape(-1, rows, len(white) * columns), fps)
    elif suffix == ".png":
        io.write(path, shown.transpose(0, 1, 3, 2, 4).reshape(-1, shown.shape[2] * x.shape[-1]))
    else:
        known = ", ".join(sorted({*_formats.VIDEO, *STACKS, ".png"}))
        raise FormatError(f"{path}: cannot export as {suffix or 'a file without suffix'}; known are {known}")


def as_dataset(result: Result, fps: float | None) -> xarray.Dataset:
    """A result as labelled arrays of xarray, see :meth:`pnp_sci.Result.to_xarray`."""
    with needed_for("to_xarray", "xarray"):
        import xarray
    names = ("measurement", "view", "frame", "row", "column")[-result.x.ndim :]
    arrays: dict[str, Any] = {"x": (names, result.x)}
    if result.uncertainty is not None:
        arrays["uncertainty"] = (names, result.uncertainty)
    coordinates: dict[str, Any] = {name: np.arange(length) for name, length in zip(names, result.x.shape)}
    if fps is not None:
        frames = result.x.shape[-3] * np.arange(len(result.x) if result.x.ndim == 5 else 1)
        times = (frames[:, None] + np.arange(result.x.shape[-3])) / positive_number("fps", fps)
        dims = ("measurement", "frame") if result.x.ndim == 5 else ("frame",)
        coordinates["time"] = (dims, times.reshape(*result.x.shape[:-4], -1), {"units": "s"})
    told = {"status": result.status.value, "remarks": "\n".join(result.remarks)}
    return xarray.Dataset(arrays, coordinates, told | {"settings": json.dumps(result.settings, default=str)})


def parts(result: Result, numbers: Sequence[int]) -> dict[str, Any]:
    """The fields of the result of these measurements alone; `History` counts them from 0."""
    count = len(result.x)
    windows = sorted({record.measurement for record in result.history})
    own = [max((w for w in windows if w <= n), default=0) for n in numbers]
    records = [(k, record) for k in dict.fromkeys(own) for record in result.history if record.measurement == k]
    settings = dict(result.settings)
    for name, values in settings.items():
        if name in PER_WINDOW and isinstance(values, list) and len(values) == len(windows):
            settings[name] = [values[windows.index(k)] for k in dict.fromkeys(own)]
        elif name in PER_MEASUREMENT and isinstance(values, list) and len(values) == count:
            settings[name] = [values[n] for n in numbers]
    return {
        "records": [(own.index(k), record) for k, record in records],
        "settings": settings,
        "scenes": [result.scenes[n] for n in numbers if n < len(result.scenes)],
    }


PER_MEASUREMENT, PER_WINDOW = ("noise", "unit"), ("plan", "share", "status")  # lists in the settings
