"""Videos as TIFF with their values: views are channels, frames are times; for ImageJ, or with OME-XML."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pnp_sci.errors import InputError
from pnp_sci.formats.channels import names

SUFFIXES = ".tif", ".tiff"


def is_ome(path: Path) -> bool:
    """Whether the name asks for OME-XML.

    >>> is_ome(Path("views.OME.tif"))
    True
    """
    return Path(path.stem).suffix.lower() == ".ome"


def save(path: Path, x: np.ndarray, fps: float, white: np.ndarray, ome: bool, colour: bool) -> None:
    """Write videos (N, V, B, H, W) as float32, axes TCYX, one measurement after the other in T.

    `white` (V,) is what ImageJ first shows as white; the values stay. With `colour` three channels are a view.

    Raises
    ------
    InputError
        If the largest value is too large or too small for float32.
    """
    import tifffile

    top, known = max(float(x.max()), -float(x.min())), np.finfo(np.float32)
    if top > float(known.max) or 0 < top < float(known.tiny):
        raise InputError(f"{path}: the video reaches {top:.3g}, but this TIFF has float32; Result.save keeps float64")
    views = x.shape[1]
    stack = np.ascontiguousarray(x.swapaxes(1, 2).reshape(-1, views, *x.shape[3:]), np.float32)
    named = names(views, colour)
    if ome or stack.shape[-1] == 1:  # tifffile would read a single column for ImageJ as colour samples
        channels = {"Channel": {"Name": named}} if views > 1 else {}
        times = {"TimeIncrement": 1 / fps, "TimeIncrementUnit": "s"}
        about = {"axes": "TCYX", **times, **channels}
        tifffile.imwrite(path, stack, ome=True, photometric="minisblack", metadata=about)
        return
    ranges = tuple(float(value) for level in white for value in (0, level))
    about = {"axes": "TCYX", "ndim": 4, "fps": fps, "finterval": 1 / fps, "mode": "grayscale"}
    about |= {"Labels": named * len(stack), "Ranges": ranges, "min": 0.0, "max": float(white.max())}
    tifffile.imwrite(path, stack, imagej=True, metadata=about)
