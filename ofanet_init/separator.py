"""The dual-net separator: a first estimate of every view from one measurement."""

from __future__ import annotations

import torch
from torch import nn

from ofanet_init.blocks import activation, chain, convolution, residual_block


class Branch(nn.Module):
    """One branch: cnn1 to half resolution, three residual blocks, and cnn3 back, with a skip connection from cnn1."""

    def __init__(self, inputs: int, outputs: int):
        super().__init__()
        self.cnn1 = nn.Sequential(
            chain(inputs, (5, 32), (3, 64), (1, 64)), convolution(64, 64, 3, stride=2), activation()
        )
        self.cnn2 = nn.Sequential(*(residual_block(64) for _ in range(3)))
        self.cnn3 = nn.Sequential(
            nn.ConvTranspose2d(128, 64, 3, stride=2, padding=1, output_padding=1),
            activation(),
            chain(64, (1, 64), (3, 32), (1, outputs), last=False),
        )

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, inputs, H, W) -> (N, outputs, H, W), H and W even."""
        fine = self.cnn1(x)
        return self.cnn3(torch.cat([self.cnn2(fine), fine], 1))


class Separator(nn.Module):
    """Branches of equal architecture with separate parameters, one per view; one for all views if not `dual`."""

    def __init__(self, views: int, frames: int, diversity: int, dual: bool):
        super().__init__()
        self.views, self.frames = views, frames
        count = views if dual else 1
        each = views // count * frames
        self.branches = nn.ModuleList(Branch(1 + diversity + each, each) for _ in range(count))

    def forward(self, common: torch.Tensor, diversity: torch.Tensor, masks: torch.Tensor) -> torch.Tensor:
        """First estimates (N, V, B, H, W).

        The inputs of a branch are `common`, the normalised measurement (N, 1, H, W), and `diversity`, the images D
        (N, 0 or 2 V, H, W). A third input is the normalised measurement times each of its masks (N, V, B, H, W).
        """
        coded = (common[:, None] * masks).flatten(1, 2).chunk(len(self.branches), 1)
        videos = [branch(torch.cat([common, diversity, part], 1)) for branch, part in zip(self.branches, coded)]
        return torch.cat(videos, 1).unflatten(1, (self.views, self.frames))
