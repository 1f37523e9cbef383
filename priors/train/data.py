"""Noisy crops of clips and photographs, to train denoisers on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pnp_sci.errors import FormatError
from pnp_sci.training.clips import Clip, fold

FRAME, CLIP = 0.2, 0.7  # parts of the single frames, and of the clips, that have some of a snapshot's noise


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
            raise FormatError("data: clips of more than one frame were expected")

    def __call__(self, rank: int, step: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return clean and noisy crops (batch, frames, crop, crop) in [0, 1] and their noise levels (batch,)."""
        random = np.random.default_rng([self.seed, rank, step])
        clean = np.stack([self.piece(random) for _ in range(self.batch)]).astype(np.float32) / 255
        sigma = np.array([noise_level(random) for _ in range(self.batch)], np.float32)
        noise = np.stack([unit_noise(random, clean.shape[1:]) for _ in range(self.batch)])
        return clean, clean + sigma[:, None, None, None] * noise, sigma

    def piece(self, random: np.random.Generator) -> np.ndarray:
        """Draw a crop of some frames of a clip, uint8 (frames, crop, crop), turned and flipped."""
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
    """Draw noise of unit variance, float32 (B, H, W): white, and for some crops partly a snapshot's.

    A projection onto a measurement spreads one residual over all frames through their masks, so that the noise a
    solver hands to its prior is the same in the frames whose masks are open, and nothing where they are closed.
    For clips 0.7 in the place of 0.2 loses 0.1 dB on white noise and gains 0.1 to 0.3 dB in the solver.
    """
    white = random.standard_normal(shape, np.float32)
    if random.random() > (FRAME if shape[0] == 1 else CLIP):
        return white
    masks = random.random(shape, np.float32) < 0.5
    snapshot = np.float32(np.sqrt(2)) * masks * random.standard_normal(shape[1:], np.float32)
    portion = np.float32(random.random())
    return np.sqrt(1 - portion) * white + np.sqrt(portion) * snapshot
