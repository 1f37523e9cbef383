"""Results as layers of napari: each view is an image, and its predicted error another one, hidden at first."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, MissingExtraError
from pnp_sci.results.result import Result

Layer = tuple[np.ndarray, dict[str, Any], str]


def reader(path: str | list[str]) -> Callable[[Any], list[Layer]] | None:
    """A function that reads the path, if it is a result of this package; None if it is not (napari's protocol)."""
    if not isinstance(path, str):
        return None
    try:
        layers = layers_of(Result.load(path), Path(path).stem)
    except (FormatError, FileNotFoundError, MissingExtraError):
        return None
    return lambda _: layers


def layers_of(result: Result, name: str) -> list[Layer]:
    """Layers of each view, (N * B, H, W): the video from 0 to white and, if it is known, its predicted error.

    Examples
    --------
    >>> from pnp_sci import History, Status
    >>> result = Result(np.ones((2, 3, 4, 5)), Status.CONVERGED, History(), {})
    >>> [(data.shape, kept["name"], kind) for data, kept, kind in layers_of(result, "cells")]
    [((3, 4, 5), 'cells view 1', 'image'), ((3, 4, 5), 'cells view 2', 'image')]
    """
    about = {"status": result.status.value, "settings": result.settings, "remarks": result.remarks}
    layers = _layers(result.x, name, (0.0, result.white), visible=True, metadata=about, colormap="gray")
    if result.uncertainty is not None:
        errors = np.nan_to_num(result.uncertainty)
        largest = float(errors.max()) or 1.0
        layers += _layers(errors, f"{name} uncertainty", (0.0, largest), visible=False, colormap="magma")
    return layers


def _layers(x: np.ndarray, name: str, limits: tuple[float, float], **kept: Any) -> list[Layer]:
    videos = x.reshape(-1, *x.shape[-4:]).swapaxes(0, 1)
    return [
        (video.reshape(-1, *x.shape[-2:]), {"name": f"{name} view {view}", "contrast_limits": limits, **kept}, "image")
        for view, video in enumerate(videos, 1)
    ]
