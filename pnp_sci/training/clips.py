"""Training material: clips and photographs held in memory as 8-bit grey, and the fixed validation split."""

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
HELD_OUT = 9  # every ninth scene: ten of the scenes of our own training set


@dataclass(frozen=True)
class Clip:
    """A name and its frames, uint8 (B, H, W); a photograph is a clip of one frame."""

    name: str
    frames: np.ndarray

    @property
    def scene(self) -> str:
        """The name without a trailing number: ``gym_1`` and ``gym_2`` are pieces of one scene."""
        return re.sub(r"_\d+$", "", self.name)


def decoded(file: Path) -> np.ndarray:
    """The frames of a video as luma (BT.601), uint8 (B, H, W)."""
    video = cv2.VideoCapture(str(file))
    frames = []
    while (read := video.read())[0]:
        frames.append(cv2.cvtColor(read[1], cv2.COLOR_BGR2GRAY))
    if not frames:
        raise FormatError(f"data: {file.name} holds no frame that can be decoded")
    return np.stack(frames)


def load_clips(folders: Sequence[Path]) -> list[Clip]:
    """Decode every video and photograph of `folders`, sorted by name.

    Raises
    ------
    pnp_sci.errors.FormatError
        If the folders hold no video and no photograph.
    """
    files = sorted((f for folder in folders for f in Path(folder).iterdir()), key=lambda f: f.name)
    clips = []
    for file in files:
        if file.suffix.lower() in VIDEOS:
            clips.append(Clip(file.stem, decoded(file)))
        elif file.suffix.lower() in PHOTOGRAPHS:
            image = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
            if image is None:
                raise FormatError(f"data: {file.name} holds no picture that can be decoded")
            clips.append(Clip(file.stem, image[None]))
    if not clips:
        raise FormatError(f"data: no video and no photograph in {', '.join(str(folder) for folder in folders)}")
    return clips


def split(clips: Sequence[Clip]) -> tuple[list[Clip], list[Clip]]:
    """Training and validation clips: of the scenes with moving frames, sorted by name, every ninth is held out.

    All clips of a scene that is held out leave the training set; its first clip is validated.
    """
    scenes = sorted({clip.scene for clip in clips if len(clip.frames) > 1})
    held_out = scenes[::HELD_OUT] if len(scenes) > 1 else []
    firsts = {scene: min(clip.name for clip in clips if clip.scene == scene) for scene in held_out}
    training = [clip for clip in clips if clip.scene not in firsts]
    return training, [clip for clip in clips if firsts.get(clip.scene) == clip.name]


def fold(index: np.ndarray, length: int) -> np.ndarray:
    """Bring any index into 0..length-1 by reflection, so that short or small clips serve too."""
    period = max(2 * (length - 1), 1)
    index = index % period
    return np.minimum(index, period - index) if length > 1 else np.zeros_like(index)
