"""Noisy crops of clips and photographs: training samples of denoisers."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pnp_sci.errors import FormatError
from pnp_sci.training.clips import Clip, fold

FRAME, CLIP = 0.2, 0.7  # fractions of single frames and of clips with snapshot noise, see unit_noise


class Sampler:
    """Random clean and noisy crops, determined by (seed, rank, step).

    Clips have equal probability. For single frames, photographs and clips each have probability 1/2 if there are both.

    Parameters
    ----------
    clips : sequence of Clip
    frames, crop, batch : int
        Frames of a sample, its height and width in pixels, and samples per batch.
    seed : int

    Raises
    ------
    FormatError
        If no clip can be used.
    """

    def __init__(self, clips: Sequence[Clip], *, frames: int, crop: int, batch: int, seed: int):
        self.frames, self.crop, self.batch, self.seed = frames, crop, batch, seed
        moving = [clip.frames for clip in clips if len(clip.frames) > 1]
        still = [clip.frames for clip in clips if len(clip.frames) == 1]
        self.pools = [pool for pool in ([moving, still] if frames == 1 else [moving]) if pool]
        if not self.pools:
            raise FormatError("data: clips of more than one frame were expected")

    def __call__(self, rank: int, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Clean and noisy crops (batch, frames, crop, crop), in units where white is 1, and noise levels (batch,)."""
        random = np.random.default_rng([self.seed, rank, step])
        clean = np.stack([self.piece(random) for _ in range(self.batch)]).astype(np.float32) / 255
        sigma = np.array([noise_level(random) for _ in range(self.batch)], np.float32)
        noise = np.stack([unit_noise(random, clean.shape[1:]) for _ in range(self.batch)])
        return clean, clean + sigma[:, None, None, None] * noise, sigma

    def piece(self, random: np.random.Generator) -> np.ndarray:
        """Draw a crop of consecutive or alternate frames, uint8 (frames, crop, crop), randomly rotated and mirrored."""
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
    """Draw a standard deviation in [0, 75/255]: log-uniform in 5-50 of 255 with probability 0.8, else uniform."""
    if random.random() < 0.2:
        return random.uniform(0, 75) / 255
    return float(np.exp(random.uniform(np.log(5), np.log(50)))) / 255


def unit_noise(random: np.random.Generator, shape: tuple[int, ...]) -> np.ndarray:
    """Draw noise of unit variance, float32 (B, H, W): white, and for some crops partly snapshot noise.

    A projection onto a measurement adds the same residual to all frames, times their masks. So the noise of a solver's
    estimate is equal in frames whose masks are open, and 0 where they are closed.
    """
    white = random.standard_normal(shape, np.float32)
    if random.random() > (FRAME if shape[0] == 1 else CLIP):
        return white
    masks = random.random(shape, np.float32) < 0.5
    snapshot = np.float32(np.sqrt(2)) * masks * random.standard_normal(shape[1:], np.float32)
    portion = np.float32(random.random())
    return np.sqrt(1 - portion) * white + np.sqrt(portion) * snapshot
