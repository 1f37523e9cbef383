"""Films: MP4, AVI, MOV, MKV by PyAV, and GIF. All frames that are shown are read, whatever their times."""

from __future__ import annotations

import errno
import re
import struct
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.pictures import eight_bit

DEEP = (9, 10, 12, 14, 16)  # bits of grey samples beside 8; 16 hold all others
DURATION = re.compile(r"(\d+):(\d+):([0-9.]+)$")  # of a stream in MKV
UNKNOWN = 2**32 - 1  # size of an AVI whose writer could not go back to its beginning


def load(path: Path, colour: bool = False) -> np.ndarray:
    """The frames (B, H, W), in colour (B, H, W, 3), as uint8, uint16 for more bits, or float32 for grey floats."""
    av, content = _av(), bytearray()
    frame = None
    try:
        with av.open(_url(path), metadata_errors="replace") as film:
            if not film.streams.video:
                raise FormatError(f"{path} holds no film: one of MP4, AVI, MOV or MKV was expected")
            _check_size(path, film)
            for frame in _shown(path, film, colour):
                content += frame.tobytes()
    except (av.FFmpegError, IndexError) as error:  # PyAV has no stream where a packet is of an unknown one
        raise _damaged(path, str(error)) from error
    if frame is None:
        raise _damaged(path, "no frame is shown")
    return np.frombuffer(content, frame.dtype).reshape(-1, *frame.shape)


def _check_size(path: Path, film: Any) -> None:
    """Raise a FormatError if an AVI, whose times are incomplete, is smaller than it declares."""
    with path.open("rb") as file:
        _, size = struct.unpack("<4sI", file.read(8))
    if film.format.name == "avi" and path.stat().st_size < 8 + size < UNKNOWN:
        raise FormatError(f"{path} has {path.stat().st_size} bytes of {8 + size}, it is truncated")


def _shown(path: Path, film: Any, colour: bool) -> Iterator[np.ndarray]:
    """The frames of a film, as arrays; raises a FormatError if one is damaged or the last ones are missing."""
    stream = film.streams.video[0]
    stream.thread_type = "AUTO"
    ends: list[float] = []  # of frames, in seconds
    sound, cut = 0.0, False  # sound may go on after the film; an edit list cuts away what is discarded
    as_first: dict[str, Any] = {}
    for packet in film.demux(stream, *film.streams.audio):
        if packet.stream.index != stream.index:
            sound = max(sound, _end(packet))
            continue
        if packet.is_corrupt:
            raise _damaged(path, "a part of it is incomplete")
        cut = cut or packet.is_discard
        for frame in packet.decode():
            as_first = as_first or {"width": frame.width, "height": frame.height, "format": _pixels(frame, colour)}
            ends.append(_end(frame))
            yield _upright(frame, frame.reformat(**as_first).to_ndarray())
    end, declared = max(ends, default=0.0), _seconds(film, stream)
    frame = (end - min(ends, default=0.0)) / max(len(ends) - 1, 1)
    tolerance = (1.8 if cut else 0.8) * frame + 0.006  # a cut may part a frame; durations are rounded to 0.01 s
    if film.format.name != "avi" and max(end, sound) < declared - tolerance:
        raise FormatError(f"{path}: {end:.2f} of {declared:.2f} seconds can be read, the file seems truncated")


def _end(shown: Any) -> float:
    """Seconds at which a packet or a frame ends; 0 if it has no time."""
    return 0.0 if shown.pts is None else float((shown.pts + (shown.duration or 0)) * shown.time_base)


def _upright(frame: Any, pixels: np.ndarray) -> np.ndarray:
    """Pixels (H, W) or (H, W, 3) of a frame as its matrix of display turns and mirrors them, by quarter turns."""
    matrix = frame.side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return pixels
    (a, b, _), (c, d, _), _ = np.frombuffer(matrix, np.int32).reshape(3, 3).tolist()
    across, down = (a, d) if abs(a) > abs(b) else (c, b)
    pixels = pixels if abs(a) > abs(b) else pixels.swapaxes(0, 1)
    return pixels[:: -1 if down < 0 else 1, :: -1 if across < 0 else 1]


def _pixels(frame: Any, colour: bool) -> str:
    """The format of pixels in which no bits of a frame are lost."""
    bits = max(component.bits for component in frame.format.components)
    if colour:
        return "rgb24" if bits <= 8 else "rgb48le"
    if bits <= 8:
        return "gray"
    if bits == 32:
        return "grayf32le"
    return f"gray{bits if bits in DEEP else 16}le"


def _seconds(film: Any, stream: Any) -> float:
    """Declared duration: of the stream, in MKV too, or of the whole film; 0 if it is not."""
    if told := DURATION.match(stream.metadata.get("DURATION", "")):
        hours, minutes, seconds = map(float, told.groups())
        return 3600 * hours + 60 * minutes + seconds
    return float(stream.duration * stream.time_base) if stream.duration else (film.duration or 0) / 1e6


def _damaged(path: Path, why: str) -> FormatError:
    return FormatError(f"{path} cannot be read to its end, it may be damaged: {why}")


def save(path: Path, frames: np.ndarray, fps: float) -> None:
    """Write frames (B, H, W) or (B, H, W, 3) as H.264, AVI (uncompressed) or GIF.

    AVI is exact for 8 bits, and so is GIF for grey ones.

    Players need H.264 of even sizes: the last row or column of others is repeated.
    """
    av = _av()
    colour = frames.ndim == 4 and frames.shape[-1] == 3
    if not (frames.ndim == 3 or colour) or frames.size == 0:
        expected = "(frames, rows, columns), or in colour (frames, rows, columns, 3), was expected"
        raise InputError(f"frames has shape {frames.shape}: {expected}")
    frames = np.ascontiguousarray(eight_bit(frames))
    exact = {".avi": ("rawvideo", "bgr24" if colour else "gray"), ".gif": ("gif", "pal8" if colour else "gray")}
    codec, pixels = exact.get(path.suffix.lower(), ("libx264", "yuv420p"))
    rate = _rate(min(fps, 100) if codec == "gif" else fps)  # a GIF counts time in hundredths of a second
    if codec == "libx264":
        odd = [(0, n % 2) for n in frames.shape[1:3]]
        frames = np.pad(frames, [(0, 0), *odd, *[(0, 0)] * colour], mode="edge")
    try:
        with av.open(_url(path), "w") as film:
            stream = film.add_stream(codec, rate)
            stream.height, stream.width, stream.pix_fmt = *frames.shape[1:3], pixels
            stream.options = {"crf": "12", "bf": "0"} if codec == "libx264" else {}  # B-frames need an edit list
            given = (av.VideoFrame.from_ndarray(frame, "rgb24" if colour else "gray") for frame in frames)
            for n, frame in enumerate(_with_palette(given) if pixels == "pal8" else given):
                frame.pts, frame.time_base = n, 1 / rate
                film.mux(stream.encode(frame))
            film.mux(stream.encode())
    except (av.FFmpegError, ValueError) as error:  # such as a codec that this build of ffmpeg lacks
        rows, columns = frames.shape[1:3]
        raise OSError(errno.EIO, f"{columns} x {rows} pixels could not be written as {codec}: {error}") from error


def _rate(fps: float) -> Fraction:
    """Frames per second as a fraction of two numbers of 31 bits."""
    rate = Fraction(fps).limit_denominator(1000) if fps >= 1 else 1 / Fraction(1 / fps).limit_denominator(1000)
    if max(rate.numerator, rate.denominator) >= 2**31:
        raise InputError(f"fps is {fps:g}: a number between 1e-6 and 1e6 was expected")
    return rate


def _with_palette(frames: Iterator[Any]) -> Iterator[Any]:
    """Frames of a GIF in colour, in the colours that suit all of them."""
    first = next(frames)
    graph = _av().filter.Graph()
    source = graph.add_buffer(width=first.width, height=first.height, format=first.format, time_base=Fraction(1, 100))
    split, palette, use, sink = map(graph.add, ("split", "palettegen", "paletteuse", "buffersink"))
    source.link_to(split)
    split.link_to(use, 0, 0)
    split.link_to(palette, 1, 0)
    palette.link_to(use, 0, 1)
    use.link_to(sink)
    graph.configure()
    given = [first, *frames]
    for frame in (*given, None):
        source.push(frame)
    yield from (graph.pull() for _ in given)


def load_gif(path: Path, colour: bool = False) -> np.ndarray:
    """The frames (B, H, W), in colour (B, H, W, 3), of a GIF as uint8."""
    import imageio.v3

    return imageio.v3.imread(path, plugin="pillow", mode="RGB" if colour else "L")


def _av() -> Any:
    with needed_for("reading or writing a film", "video"):
        import av
    return av


def _url(path: Path) -> str:
    """The path as ffmpeg takes it, whatever its name begins with or holds."""
    return f"file:{path.absolute()}"
