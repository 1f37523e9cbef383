"""PNG, and what all pictures have in common."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, InputError, InputTypeError

TRUE_COLOUR, GREY_ALPHA, TRUE_COLOUR_ALPHA = 2, 4, 6  # colour types of PNG (ISO 15948)


def eight_bit(frames: np.ndarray) -> np.ndarray:
    """Frames as uint8: floats are clipped to [0, 1] and scaled to 0..255, bool becomes 0 and 255."""
    if frames.dtype == np.uint8:
        return frames
    if frames.dtype != bool and frames.dtype.kind != "f":
        raise InputTypeError(f"frames have dtype {frames.dtype}: floats in [0, 1], bool or uint8 were expected")
    return np.round(np.clip(np.nan_to_num(frames.astype(np.float32)), 0, 1) * 255).astype(np.uint8)


def of_samples(path: Path, picture: np.ndarray, colour: bool = False) -> np.ndarray:
    """Grey values (..., H, W) of samples (..., H, W, S), in colour (..., H, W, 3); transparency is dropped.

    Raises
    ------
    FormatError
        If grey is asked for, and the colours are not.
    """
    samples = picture[..., :3] if picture.shape[-1] > 2 else picture[..., :1]
    if colour:
        return np.repeat(samples, 3, -1) if samples.shape[-1] == 1 else samples
    if (samples[..., :1] != samples).any():
        reader = "pnp_sci.io.read_video(path, colour=True) reads colours"
        raise FormatError(f"{path}: a colour picture came, a grey one was expected; {reader}")
    return samples[..., 0]


def load_png(path: Path, colour: bool = False) -> np.ndarray:
    """A picture (H, W) of 8 or 16 bits, in colour (H, W, 3); of an animated PNG all frames, (B, H, W)."""
    frames = [of_samples(path, f if f.ndim == 3 else f[..., None], colour) for f in _frames_of_png(path)]
    return np.stack(frames) if len(frames) > 1 else frames[0]


def _frames_of_png(path: Path) -> list[np.ndarray]:
    content = path.read_bytes()
    bits, kind = content[24], content[25]  # of the header
    if bits == 16 and kind in (TRUE_COLOUR, GREY_ALPHA, TRUE_COLOUR_ALPHA):  # Pillow would keep 8 bits
        import cv2

        picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
        if picture is None:
            raise FormatError(f"{path} cannot be read, it may be damaged")
        return [picture[..., [2, 1, 0]] if picture.ndim == 3 else picture]  # blue comes first
    import imageio.v3

    return list(imageio.v3.imiter(content, plugin="pillow", extension=".png"))


def save_png(path: Path, picture: np.ndarray, colour: bool = False) -> None:
    """Write a picture (H, W): uint16 as it is, others as 8 bits; in colour (H, W, 3), of 8 bits."""
    import imageio.v3

    if picture.ndim != 2 + colour:
        raise InputError(
            f"{path}: a PNG holds (rows, columns), but {picture.shape} came; a path without suffix makes a folder"
        )
    picture = picture if picture.dtype == np.uint16 and not colour else eight_bit(picture)
    imageio.v3.imwrite(path, picture, plugin="pillow", extension=".png")


def numbered(file: Path) -> list[Any]:
    """Sort key: numbers in names count as numbers."""
    return [int(part) if n % 2 else part for n, part in enumerate(re.split(r"([0-9]+)", file.name))]
