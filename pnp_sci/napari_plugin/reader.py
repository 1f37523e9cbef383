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
    if result.in_colour:
        shown = np.clip(result.videos / result.white, 0, 1)
        return _layers(shown, name, visible=True, metadata=about, rgb=True)
    kept = {"contrast_limits": (0.0, result.white), "colormap": "gray"}
    layers = _layers(result.videos, name, visible=True, metadata=about, **kept)
    if result.uncertainty is not None:
        errors = result.uncertainty.reshape(result.videos.shape)
        largest = float(errors.max(initial=0, where=np.isfinite(errors)))
        kept = {"contrast_limits": (0.0, largest or 1.0), "colormap": "magma"}
        layers += _layers(errors, f"{name} uncertainty", visible=False, **kept)
    return layers


def _layers(videos: np.ndarray, name: str, **kept: Any) -> list[Layer]:
    """A layer for each view of videos (N, V, B, H, W) or (N, V, B, H, W, 3)."""
    return [
        (video.reshape(-1, *videos.shape[3:]), {"name": f"{name} view {view}", **kept}, "image")
        for view, video in enumerate(videos.swapaxes(0, 1), 1)
    ]
