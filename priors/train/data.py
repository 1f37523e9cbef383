"""Training material: clips and photographs held in memory as 8-bit grey, the fixed validation split, noisy crops."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import imageio.v3 as iio
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


def grey(frame: np.ndarray) -> np.ndarray:
    """Luma (BT.601) of an RGB frame, uint8 (H, W, 3) -> (H, W)."""
    return np.rint(frame @ np.array([0.299, 0.587, 0.114], np.float32)).astype(np.uint8)


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
            clips.append(Clip(file.stem, np.stack([grey(frame) for frame in iio.imiter(file, plugin="FFMPEG")])))
        elif file.suffix.lower() in PHOTOGRAPHS:
            clips.append(Clip(file.stem, grey(iio.imread(file, plugin="pillow", mode="RGB"))[None]))
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


class Sampler:
    """Noisy crops and their clean originals; the same (seed, rank, step) always gives the same batch.

    Half of a batch for the image net comes from photographs where there are any; clips are drawn equally often.
    """

    def __init__(self, clips: Sequence[Clip], *, frames: int, crop: int, batch: int, seed: int):
        self.frames, self.crop, self.batch, self.seed = frames, crop, batch, seed
        moving = [clip.frames for clip in clips if len(clip.frames) > 1]
        still = [clip.frames for clip in clips if len(clip.frames) == 1]
        self.pools = [pool for pool in ([moving, still] if frames == 1 else [moving]) if pool]
        if not self.pools:
            raise FormatError("data: a net for video needs clips of more than one frame")

    def __call__(self, rank: int, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return clean and noisy crops (batch, frames, crop, crop) in [0, 1] and their noise levels (batch,)."""
        random = np.random.default_rng([self.seed, rank, step])
        clean = np.stack([self._crop(random) for _ in range(self.batch)]).astype(np.float32) / 255
        sigma = np.array([noise_level(random) for _ in range(self.batch)], np.float32)
        noise = np.stack([unit_noise(random, clean.shape[1:]) for _ in range(self.batch)])
        return clean, clean + sigma[:, None, None, None] * noise, sigma

    def _crop(self, random: np.random.Generator) -> np.ndarray:
        pool = self.pools[random.integers(len(self.pools))]
        frames = pool[random.integers(len(pool))]
        count, height, width = frames.shape
        stride = int(random.integers(1, 3))
        times = random.integers(max(count - (self.frames - 1) * stride, 1)) + np.arange(self.frames) * stride
        rows = random.integers(max(height - self.crop, 0) + 1) + np.arange(self.crop)
        columns = random.integers(max(width - self.crop, 0) + 1) + np.arange(self.crop)
        crop = frames[np.ix_(fold(times, count), fold(rows, height), fold(columns, width))]
        turned = np.rot90(crop, int(random.integers(4)), axes=(1, 2))
        return turned[:: random.choice([-1, 1]), :, :: random.choice([-1, 1])]


def noise_level(random: np.random.Generator) -> float:
    """Draw a standard deviation: mostly log-uniform in 5-50 of 255, now and then uniform in 0-75."""
    if random.random() < 0.2:
        return random.uniform(0, 75) / 255
    return float(np.exp(random.uniform(np.log(5), np.log(50)))) / 255


def unit_noise(random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draw noise of unit variance, float32 (B, H, W): white, and for one crop in five partly a snapshot's.

    A projection onto a measurement spreads one residual over all frames through their masks, so that the noise a
    solver hands to its prior is the same in the frames whose masks are open, and nothing where they are closed.
    """
    white = random.standard_normal(shape, np.float32)
    if random.random() > 0.2:
        return white
    masks = random.random(shape, np.float32) < 0.5
    snapshot = np.float32(np.sqrt(2)) * masks * random.standard_normal(shape[1:], np.float32)
    portion = np.float32(random.random())
    return np.sqrt(1 - portion) * white + np.sqrt(portion) * snapshot
