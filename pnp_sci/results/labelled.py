"""A result as a data set of xarray: axes and units have names."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci._validate import positive_number
from pnp_sci.formats.plain import as_json
from pnp_sci.results.history import History

if TYPE_CHECKING:
    from xarray import Dataset

DIMS = "measurement", "view", "frame", "y", "x", "colour"  # the last one of colour videos only


def labelled(result: Any, fps: float | None) -> Dataset:
    """What :meth:`pnp_sci.Result.to_xarray` returns."""
    with needed_for("result.to_xarray()", "xarray"):
        import xarray

    def films(array: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
        videos = array.reshape(result.videos.shape)
        return DIMS[: videos.ndim], videos

    variables: dict[str, Any] = {"video": films(result.x), "history": (("record", "field"), result.history.table())}
    if result.uncertainty is not None:
        variables["uncertainty"] = films(result.uncertainty)
    counts = variables["video"][1].shape
    coordinates: dict[str, Any] = {dim: np.arange(count) for dim, count in zip(DIMS, counts)}
    coordinates["field"] = list(History.names)
    if fps is not None:
        times = np.arange(counts[2]) / positive_number("fps", fps)
        coordinates["time"] = ("frame", times, {"units": "s"})
    texts = {key: as_json(getattr(result, key)) for key in ("settings", "scenes", "remarks")}
    return xarray.Dataset(variables, coordinates, {"status": result.status.value, **texts})
