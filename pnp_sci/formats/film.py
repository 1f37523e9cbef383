"""Films: MP4, AVI, MOV, MKV by ffmpeg, and GIF. All frames that are stored are read, whatever their times."""

from __future__ import annotations

import errno
import re
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.pictures import eight_bit

DEEP = re.compile(r"(?<![0-9])(9|10|12|14|16)(le|be)")  # the bits in the name of ffmpeg's pixel formats, if above 8
START = re.compile(r"start: (-?[0-9.]+)")  # seconds of the first frame
PALETTE = "split[a][b];[a]palettegen[p];[b][p]paletteuse"  # of a GIF: the colours that suit the film
BROKEN = re.compile(r"prematurely|partial file|truncat|invalid data|moov atom not found", re.IGNORECASE)


def load(path: Path, colour: bool = False) -> np.ndarray:
    """The frames (B, H, W), in colour (B, H, W, 3), as uint8, or uint16 for films of more bits."""
    with closing(_ffmpeg().read_frames(_url(path))) as reader:
        meta = next(reader)
    deep = DEEP.search(meta["pix_fmt"])
    if colour:
        pixels, kind, depth = ("rgb48le", "<u2", (3,)) if deep else ("rgb24", "u1", (3,))
    else:
        pixels, kind, depth = (f"gray{deep[1]}le", "<u2", ()) if deep else ("gray", "u1", ())
    content = _output(path, "-fps_mode", "passthrough", "-f", "rawvideo", "-pix_fmt", pixels)
    columns, rows = meta["size"]
    values = np.frombuffer(content, kind)
    frames = values.reshape(-1, rows, columns, *depth).astype(values.dtype.newbyteorder("="), copy=False)
    _check_end(path, len(frames), meta)
    return frames


def _output(path: Path, *options: str) -> bytes:
    """What ffmpeg makes of the film."""
    command = [_ffmpeg().get_ffmpeg_exe(), "-v", "error", "-i", _url(path), "-map", "0:v:0", *options, "-"]
    done = subprocess.run(command, capture_output=True)
    said = done.stderr.decode(errors="replace").strip()
    if done.returncode or BROKEN.search(said):
        raise FormatError(f"{path} cannot be read to its end, it may be damaged: {said.partition(chr(10))[0]}")
    return done.stdout


def _check_end(path: Path, count: int, meta: dict[str, Any]) -> None:
    """Raise a FormatError if the last of `count` frames ends before the film does."""
    listed = _output(path, "-c", "copy", "-f", "framecrc").decode()  # stream, dts, pts, duration, size, checksum
    ticks, second = map(int, re.search(r"#tb 0: (\d+)/(\d+)", listed).groups())  # type: ignore[union-attr]
    frames = sorted(tuple(map(int, line.split(",")[2:4])) for line in listed.splitlines() if line[0] != "#")
    end = max(((time + lasts) * ticks / second for time, lasts in frames[:count]), default=0.0)
    head = subprocess.run([_ffmpeg().get_ffmpeg_exe(), "-i", _url(path)], capture_output=True).stderr
    start = START.search(head.decode(errors="replace"))
    expected = meta["duration"] - max(float(start[1]) if start else 0.0, 0.0)
    tolerance = 0.8 / meta["fps"] + 0.006  # the duration is rounded to 0.01 s; a missing frame is an error
    if meta.get("audio_codec"):
        tolerance += 0.1 * expected  # the sound may be longer than the film
    if end < expected - tolerance:
        raise FormatError(f"{path}: {end:.2f} of {expected:.2f} seconds can be read, the file seems truncated")


def save(path: Path, frames: np.ndarray, fps: float) -> None:
    """Write frames (B, H, W) or (B, H, W, 3) as H.264, AVI (uncompressed) or GIF.

    AVI is exact for 8 bits, and so is GIF for grey ones.

    Players need H.264 of even sizes: the last row or column of others is repeated.
    """
    colour = frames.ndim == 4 and frames.shape[-1] == 3
    if not (frames.ndim == 3 or colour) or frames.size == 0:
        expected = "(frames, rows, columns), or in colour (frames, rows, columns, 3), was expected"
        raise InputError(f"frames has shape {frames.shape}: {expected}")
    frames = eight_bit(frames)
    exact = {
        ".avi": ["rawvideo", "-pix_fmt", "bgr24" if colour else "gray"],
        ".gif": ["gif", *(["-filter_complex", PALETTE] if colour else ["-pix_fmt", "gray"])],
    }
    codec = exact.get(path.suffix.lower())
    if codec is None:
        codec = ["libx264", "-pix_fmt", "yuv420p", "-crf", "12"]
        odd = [(0, n % 2) for n in frames.shape[1:3]]
        frames = np.pad(frames, [(0, 0), *odd, *[(0, 0)] * colour], mode="edge")
    rows, columns = frames.shape[1:3]
    raw = [
        "-f",
        "rawvideo",
        "-pix_fmt",
        "rgb24" if colour else "gray",
        "-s",
        f"{columns}x{rows}",
        "-r",
        f"{fps:.10g}",
        "-i",
        "-",
    ]
    done = subprocess.run(
        [_ffmpeg().get_ffmpeg_exe(), "-y", "-v", "error", *raw, "-c:v", *codec, _url(path)],
        input=np.ascontiguousarray(frames).data,
        capture_output=True,
    )
    said = done.stderr.decode(errors="replace").strip()
    if done.returncode or said or not path.is_file() or path.stat().st_size == 0:
        why = said.splitlines()[-1] if said else "no reason given"
        raise OSError(errno.EIO, f"ffmpeg could not write {columns} x {rows} pixels as {codec[0]}: {why}")


def load_gif(path: Path, colour: bool = False) -> np.ndarray:
    """The frames (B, H, W), in colour (B, H, W, 3), of a GIF as uint8."""
    import imageio.v3

    return imageio.v3.imread(path, plugin="pillow", mode="RGB" if colour else "L")


def _ffmpeg() -> Any:
    with needed_for("reading or writing a film", "video"):
        import imageio_ffmpeg
    return imageio_ffmpeg


def _url(path: Path) -> str:
    """The path as ffmpeg takes it, whatever its name begins with or holds."""
    return f"file:{path.absolute()}"
