"""A result in a notebook: a table, a picture of some frames and a small film, all within the HTML."""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from PIL import Image

from pnp_sci.errors import MissingExtraError
from pnp_sci.formats import film
from pnp_sci.formats.brightness import of_views
from pnp_sci.formats.pictures import eight_bit

SHOWN = 5  # frames side by side
FPS = 5
# Pixels of the longer side of a frame in the picture, and of all views together in the film, and limits of their files:
# frames are shrunk until they are kept. Smaller frames are enlarged.
PICTURE_SIDE, PICTURE_BYTES = 160, 400_000
FILM_SIDE, FILM_BYTES = 512, 600_000


@dataclass(frozen=True)
class Shown:
    """What a notebook shows."""

    html: str

    def _repr_html_(self) -> str:
        return self.html


def as_html(rows: Mapping[str, str], x: np.ndarray, white: np.ndarray) -> str:
    """The table with these rows, and pictures of a video (V, B, H, W) or (V, B, H, W, 3); `white` is of each view."""
    cells = "".join(f"<tr><th>{key}</th><td>{escape(text)}</td></tr>" for key, text in rows.items() if text)
    video = eight_bit(np.nan_to_num(x / of_views(white, x)))
    return f"<table>{cells}</table>\n{_picture(video)}<br>\n{_player(video)}"


def _picture(video: np.ndarray) -> str:
    """Some frames from left to right, a row for each view, as PNG."""
    chosen = np.linspace(0, video.shape[1] - 1, min(video.shape[1], SHOWN)).round().astype(int)

    def file(side: int) -> bytes:
        rows = [np.concatenate([_resized(frame, side) for frame in view[chosen]], axis=1) for view in video]
        return _png(np.concatenate(rows))

    names = "frames " + ", ".join(str(frame + 1) for frame in chosen)
    return f'<img alt="{names}" title="{names}" src="{_uri("image/png", _within(PICTURE_BYTES, PICTURE_SIDE, file))}">'


def _player(video: np.ndarray) -> str:
    """All frames, the views side by side: MP4 if PyAV is installed, else GIF."""

    def frames(side: int) -> np.ndarray:
        film = np.stack([_resized(np.concatenate(views, axis=1), side) for views in video.swapaxes(0, 1)])
        return film[:, : film.shape[1] // 2 * 2, : film.shape[2] // 2 * 2]  # browsers play no H.264 of odd sizes

    try:
        file = _within(FILM_BYTES, FILM_SIDE, lambda side: _mp4(frames(side)))
        return f'<video controls loop muted src="{_uri("video/mp4", file)}"></video>'
    except (MissingExtraError, OSError):
        file = _within(FILM_BYTES, FILM_SIDE, lambda side: _gif(frames(side)))
        return f'<img alt="all frames" src="{_uri("image/gif", file)}">'


def _within(limit: int, side: int, make: Callable[[int], bytes]) -> bytes:
    """A file of pictures of this size, or of the first smaller one that is within the limit of bytes."""
    while len(file := make(side)) > limit and side > 2:
        side = int(side * 0.9 * (limit / len(file)) ** 0.5)  # bytes are about in proportion to pixels
    return file


def _resized(picture: np.ndarray, side: int) -> np.ndarray:
    """A picture (H, W) or (H, W, 3) whose longer side is about so many pixels: pixels are repeated or averaged."""
    longer = max(picture.shape[:2])
    if longer <= side:
        return picture.repeat(side // longer, axis=0).repeat(side // longer, axis=1)
    rows, columns = (max(round(length * side / longer), 2) for length in picture.shape[:2])
    return np.asarray(Image.fromarray(picture).resize((columns, rows), Image.Resampling.BOX))


def _png(picture: np.ndarray) -> bytes:
    file = BytesIO()
    Image.fromarray(picture).save(file, "PNG", optimize=True)
    return file.getvalue()


def _mp4(frames: np.ndarray) -> bytes:
    with TemporaryDirectory() as folder:
        file = Path(folder) / "film.mp4"
        film.save(file, frames, FPS)
        return file.read_bytes()


def _gif(frames: np.ndarray) -> bytes:
    file = BytesIO()
    first, *others = map(Image.fromarray, frames)
    first.save(file, "GIF", save_all=True, append_images=others, duration=1000 // FPS, loop=0)
    return file.getvalue()


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
