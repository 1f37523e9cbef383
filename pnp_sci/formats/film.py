"""Films: MP4, AVI, MOV, MKV by ffmpeg, and GIF. All frames that are shown are read, whatever their times."""

from __future__ import annotations

import errno
import re
import struct
import subprocess
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.pictures import eight_bit

DEEP = re.compile(r"(?<!444)(?<!555)(?<!565)[lb]e$")  # ends the names of ffmpeg's pixel formats of more than 8 bits
BITS = re.compile(r"(9|10|12|14|16|f32)[lb]e$")  # of a sample; where the name does not say it, 16 bits hold all
LASTS = re.compile(r": Video:(?:(?!Stream #).)*?DURATION *: (\d+):(\d+):([0-9.]+)", re.DOTALL)  # of the stream, in MKV
UNKNOWN = 2**32 - 1  # size of an AVI whose writer could not go back to its beginning
FLAGS = re.compile(r"F=0x([0-9A-F]+)")  # of a packet
DISCARDED = 4  # the flag of what an edit list cuts away
PALETTE = "split[a][b];[a]palettegen[p];[b][p]paletteuse"  # of a GIF: the colours that suit the film
BROKEN = re.compile(r"prematurely|partial file|truncat|invalid data|moov atom not found", re.IGNORECASE)


def load(path: Path, colour: bool = False) -> np.ndarray:
    """The frames (B, H, W), in colour (B, H, W, 3), as uint8, uint16 for more bits, or float32 for grey floats."""
    with closing(_ffmpeg().read_frames(_url(path))) as reader:
        meta = next(reader)
    name = meta["pix_fmt"].partition("(")[0]
    deep = DEEP.search(name)
    if colour:
        pixels, kind, depth = ("rgb48le", "<u2", (3,)) if deep else ("rgb24", "u1", (3,))
    elif deep:
        bits = found[1] if (found := BITS.search(name)) else "16"
        pixels, kind, depth = f"gray{bits}le", "<f4" if bits == "f32" else "<u2", ()
    else:
        pixels, kind, depth = "gray", "u1", ()
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
    """Raise a FormatError if the last of `count` frames ends before the film does, or the file before it should.

    Sound may go on after the film. AVI, whose times are incomplete, declares its size.
    """
    with path.open("rb") as file:
        riff, size = struct.unpack("<4sI", file.read(8))
    if riff == b"RIFF":
        if path.stat().st_size < 8 + size < UNKNOWN:
            raise FormatError(f"{path} has {path.stat().st_size} bytes of {8 + size}, it is truncated")
        return
    listed = _output(path, "-map", "0:a?", "-c", "copy", "-copyts", "-f", "framecrc").decode()
    ticks = {stream: int(a) / int(b) for stream, a, b in re.findall(r"#tb (\d+): (\d+)/(\d+)", listed)}
    film, sound, cut = [], [0.0], False
    for line in listed.splitlines():  # stream, dts, pts, duration, size, checksum
        if line[0] == "#":
            continue
        if (flags := FLAGS.search(line)) and int(flags[1], 16) & DISCARDED:
            cut = cut or line[0] == "0"
            continue
        stream, _, time, lasts = line.split(",")[:4]
        (film if stream == "0" else sound).append((int(time) + int(lasts)) * ticks[stream])
    film = sorted(film) or [0.0]
    end = film[min(count, len(film)) - 1]
    head = subprocess.run([_ffmpeg().get_ffmpeg_exe(), "-i", _url(path)], capture_output=True).stderr.decode("latin-1")
    own = LASTS.search(head)
    expected = sum(float(part) * unit for part, unit in zip(own.groups(), (3600, 60, 1))) if own else meta["duration"]
    frame = (film[-1] - film[0]) / max(len(film) - 1, 1)
    tolerance = (1.8 if cut else 0.8) * frame + 0.006  # a cut may part a frame; durations are rounded to 0.01 s
    if end < film[-1] - tolerance or max(film[-1], *sound) < expected - tolerance:
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
