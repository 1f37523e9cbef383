"""Training data: clips and photographs in memory as 8-bit grey values, and a fixed validation split."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from pnp_sci.errors import FormatError

VIDEOS = {".mp4", ".avi", ".mov", ".mkv", ".webm"}
PHOTOGRAPHS = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff"}
HELD_OUT = 9  # every ninth scene is held out


@dataclass(frozen=True)
class Clip:
    """A named clip: frames, uint8 (B, H, W). A photograph is a clip of one frame."""

    name: str
    frames: np.ndarray

    @property
    def scene(self) -> str:
        """The name without a trailing number: ``gym_1`` and ``gym_2`` are clips of one scene."""
        return re.sub(r"_\d+$", "", self.name)


def decoded(file: Path) -> np.ndarray:
    """The frames of a video file as luma (BT.601), uint8 (B, H, W)."""
    video = cv2.VideoCapture(str(file))
    frames = []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2GRAY))
    if not frames:
        raise FormatError(f"data: no frame of {file.name} can be decoded")
    return np.stack(frames)


def load_clips(folders: Sequence[Path]) -> list[Clip]:
    """Decode all videos and photographs of `folders`, sorted by name.

    Raises
    ------
    pnp_sci.errors.FormatError
        If the folders contain no video and no photograph, or a file cannot be decoded.
    """
    files = sorted((f for folder in folders for f in Path(folder).iterdir()), key=lambda f: f.name)
    clips = []
    for file in files:
        if file.suffix.lower() in VIDEOS:
            clips.append(Clip(file.stem, decoded(file)))
        elif file.suffix.lower() in PHOTOGRAPHS:
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise FormatError(f"data: {file.name} cannot be decoded as a picture")
            clips.append(Clip(file.stem, image[None]))
    if not clips:
        raise FormatError(f"data: no video and no photograph in {', '.join(str(folder) for folder in folders)}")
    return clips


def split(clips: Sequence[Clip]) -> tuple[list[Clip], list[Clip]]:
    """Split into training and validation clips: every ninth scene with several frames, sorted by name, is held out.

    No clip of a held-out scene is in the training set. The first clip of each held-out scene is in the validation set.
    """
    scenes = sorted({clip.scene for clip in clips if len(clip.frames) > 1})
    held_out = scenes[::HELD_OUT] if len(scenes) > 1 else []
    firsts = {scene: min(clip.name for clip in clips if clip.scene == scene) for scene in held_out}
    training = [clip for clip in clips if clip.scene not in firsts]
    return training, [clip for clip in clips if firsts.get(clip.scene) == clip.name]


def fold(index: np.ndarray, length: int) -> np.ndarray:
    """Map any integer index into 0..length-1 by reflection, which extends short or small clips."""
    period = max(2 * (length - 1), 1)
    index = index % period
    return np.minimum(index, period - index) if length > 1 else np.zeros_like(index)
