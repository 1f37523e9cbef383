"""Training batches made on the device: crops of clips, random masks and the resulting measurements."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ofanet_init.train.masks import random_masks
from pnp_sci.training.clips import Clip

STILL = 0.2  # fraction of samples that are panned photographs
PAN = 3.0  # pixels per frame: largest pan of a photograph
INDEPENDENT = 0.1  # fraction of batches with independent masks; the others have one moving pattern
DIM = 0.5  # fraction of samples with darker views
DARKEST = 0.3  # smallest brightness of a darker view
NOISY = 0.3  # fraction of measurements with noise
LOUDEST = 0.2  # of max(y): largest standard deviation of the noise


@dataclass(frozen=True)
class Batch:
    """A training batch. y: (N, H, W); masks, truth: (N, V, B, H, W)."""

    y: torch.Tensor
    masks: torch.Tensor
    truth: torch.Tensor


def folded(index: torch.Tensor, length: torch.Tensor) -> torch.Tensor:
    """Map any integer index into 0..length-1 by reflection."""
    period = (2 * (length - 1)).clamp(min=1)
    index = index.remainder(period)
    return torch.minimum(index, period - index).minimum(length - 1)


class Scenes:
    """Clips and photographs, stored on the device as one array of bytes and cropped by index arithmetic."""

    def __init__(self, clips: Sequence[Clip], device: torch.device):
        self.device = device
        self.bytes = torch.cat([torch.from_numpy(c.frames.ravel()) for c in clips]).to(device)
        sizes = torch.tensor([c.frames.shape for c in clips], device=device)
        self.base = torch.cat([sizes.new_zeros(1), sizes.prod(1).cumsum(0)[:-1]])
        self.frames, self.rows, self.columns = sizes.unbind(1)
        self.moving, self.still = (torch.nonzero(is_so)[:, 0] for is_so in (self.frames > 1, self.frames == 1))

    def crops(self, random: torch.Generator, samples: int, frames: int, size: int) -> torch.Tensor:
        """Random crops (samples, frames, size, size) in [0, 1].

        Crops are rotated, mirrored and reversed in time at random, with a stride of 1 or 2 frames. Photographs are
        panned.
        """

        def uniform() -> torch.Tensor:
            return torch.rand(samples, device=self.device, generator=random)

        def below(n: torch.Tensor) -> torch.Tensor:
            return (uniform() * n).long().minimum(n - 1)

        pool = self.moving if len(self.moving) else self.still
        clip = pool[below(torch.full_like(pool[:1], len(pool)).expand(samples))]
        if len(self.still):
            photograph = self.still[below(torch.full_like(pool[:1], len(self.still)).expand(samples))]
            clip = torch.where(uniform() < STILL, photograph, clip)
        count, height, width = self.frames[clip], self.rows[clip], self.columns[clip]
        pan = (count == 1)[:, None] * PAN * (2 * torch.stack([uniform(), uniform()], 1) - 1)
        stride = 1 + (uniform() < 0.5).long()
        first = below((count - (frames - 1) * stride).clamp(min=1))
        top, left = below((height - size).clamp(min=0) + 1), below((width - size).clamp(min=0) + 1)

        def axes(*values: torch.Tensor) -> list[torch.Tensor]:
            return [value[:, None, None, None] for value in values]

        t = torch.arange(frames, device=self.device)[None, :, None, None]
        i = torch.arange(size, device=self.device)[None, None, :, None]
        j = torch.arange(size, device=self.device)[None, None, None, :]
        turned, up, over, back = axes(*(uniform() < 0.5 for _ in range(4)))
        i, j = torch.where(turned, j, i), torch.where(turned, i, j)
        t, i, j = (
            torch.where(flip, n - 1 - k, k) for flip, n, k in ((back, frames, t), (up, size, i), (over, size, j))
        )
        time = folded(axes(first)[0] + axes(stride)[0] * t, axes(count)[0])
        row = folded(axes(top)[0] + i + (axes(pan[:, 0])[0] * t).round().long(), axes(height)[0])
        column = folded(axes(left)[0] + j + (axes(pan[:, 1])[0] * t).round().long(), axes(width)[0])
        base, rows, columns = axes(self.base[clip], height, width)
        return self.bytes[base + (time * rows + row) * columns + column].float() / 255


def generator(device: torch.device, seed: int, rank: int, step: int) -> torch.Generator:
    """A random generator on `device`, seeded by seed, rank and step."""
    state = np.random.SeedSequence([seed, rank, step]).generate_state(1, np.uint64)[0] >> np.uint64(1)
    return torch.Generator(device).manual_seed(int(state))


def batch(scenes: Scenes, seed: int, rank: int, step: int, shape: tuple[int, int, int, int, int]) -> Batch:
    """The batch of a seed, rank and step; shape: (N, V, B, H, W), H = W."""
    samples, views, frames, size = shape[:4]
    random = generator(scenes.device, seed, rank, step)
    truth = scenes.crops(random, samples * views, frames, size).unflatten(0, (samples, views))
    dim, factor = (torch.rand(samples, n, 1, 1, 1, device=scenes.device, generator=random) for n in (1, views))
    truth = truth * torch.where(dim < DIM, DARKEST + (1 - DARKEST) * factor, 1.0)
    # drawn on the host to avoid a synchronisation; the 1 makes it independent of the choice of the window
    independent = np.random.default_rng([seed, rank, step, 1]).random() < INDEPENDENT
    masks = random_masks(random, shape, independent)
    y = (masks * truth).sum((1, 2))
    level = torch.rand(samples, 2, device=scenes.device, generator=random)
    part = torch.where(level[:, 0] < NOISY, LOUDEST * level[:, 1] ** 2, 0)
    sigma = part[:, None, None] * y.amax((1, 2), keepdim=True)
    return Batch(y + sigma * torch.randn(y.shape, device=scenes.device, generator=random), masks, truth)
