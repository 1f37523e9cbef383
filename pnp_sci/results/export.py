"""Results for looking at: films, pictures and stacks."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pnp_sci import io
from pnp_sci.errors import FormatError
from pnp_sci.formats import films_as_tiff
from pnp_sci.formats.arrays import VIDEO
from pnp_sci.formats.brightness import of_views
from pnp_sci.formats.channels import as_channels
from pnp_sci.formats.pictures import save_png
from pnp_sci.formats.replacing import replacing


def export(path: Path, videos: np.ndarray, levels: np.ndarray, fps: float) -> None:
    """Write videos (N, V, B, H, W) or (N, V, B, H, W, 3) in the format of the path's suffix.

    `levels` is white of each view. See :meth:`pnp_sci.Result.export`.
    """
    suffix = path.suffix.lower()
    count, views, frames, rows, columns, *colours = videos.shape
    if suffix in films_as_tiff.SUFFIXES:
        stack = as_channels(videos) if colours else videos
        with replacing(path) as temporary:
            levels = np.repeat(levels, stack.shape[1] // views)
            films_as_tiff.save(temporary, stack, fps, levels, films_as_tiff.is_ome(path), bool(colours))
        return
    shown = np.clip(videos / of_views(levels, videos[0]), 0, 1).astype(np.float32)
    if suffix in VIDEO:
        beside = np.moveaxis(shown, 1, 3).reshape(count * frames, rows, views * columns, *colours)
        io.write_video(path, beside, fps)
    elif suffix == ".png":
        beside = np.moveaxis(shown, 2, 3).reshape(count * views * rows, frames * columns, *colours)
        with replacing(path) as temporary:
            save_png(temporary, beside, bool(colours))
    else:
        known = ", ".join(sorted({*VIDEO, *films_as_tiff.SUFFIXES, ".png"}))
        raise FormatError(f"{path}: cannot export as {suffix or 'a file without suffix'}; known are {known}")
