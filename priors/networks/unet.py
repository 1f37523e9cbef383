"""The network of the learned priors: a small U-net with a map of the noise level as input.

This module imports torch; the priors import it when a session begins.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import nn

from pnp_sci.accel.fusion import Residual
from priors.networks import LIMIT


@dataclass(frozen=True)
class Architecture:
    """Architecture of a network.

    Parameters
    ----------
    widths, blocks : tuple of int
        Number of channels and of residual blocks at each scale, finest first.
    """

    widths: tuple[int, ...]
    blocks: tuple[int, ...]

    def __post_init__(self):
        for name, values, most in (("widths", self.widths, 4096), ("blocks", self.blocks, 64)):
            if not values or not all(isinstance(n, int) and 1 <= n <= most for n in values):
                raise ValueError(f"{name} is {values}: whole numbers from 1 to {most} were expected")
        if len(self.widths) != len(self.blocks):
            raise ValueError(f"there are {len(self.widths)} widths, but {len(self.blocks)} blocks")

    @property
    def multiple(self) -> int:
        """Height and width are padded to a multiple of this: a factor of 2 for the unshuffling and for each scale."""
        return 2 ** len(self.widths)


SMALL = Architecture(widths=(32, 48, 64), blocks=(1, 1, 2))


def reflected(index: torch.Tensor, length: int) -> torch.Tensor:
    """Map any integer index into 0..length-1 by reflection about the first and the last element.

    >>> reflected(torch.arange(-2, 5), 3).tolist()
    [2, 1, 0, 1, 2, 1, 0]
    """
    period = max(2 * (length - 1), 1)
    folded = index.remainder(period)
    return torch.minimum(folded, period - folded).clamp(max=length - 1)


def continued(length: int, multiple: int, device: torch.device | None = None) -> torch.Tensor:
    """Indices of `length` pixels, continued to the next multiple by reflection.

    >>> continued(6, 4).tolist()
    [0, 1, 2, 3, 4, 5, 4, 3]
    """
    return reflected(torch.arange(-(-length // multiple) * multiple, device=device), length)


def conv(inputs: int, outputs: int, size: int = 3, stride: int = 1) -> nn.Conv2d:
    """Convolution without bias, for scale equivariance: D(a x, a sigma) = a D(x, sigma) for a > 0."""
    return nn.Conv2d(inputs, outputs, size, stride, padding=(size - 1) // 2, bias=False)


def enlargement(fine: int, coarse: int) -> nn.ConvTranspose2d:
    """Transposed convolution that doubles height and width."""
    layer = nn.ConvTranspose2d(coarse, fine, 2, 2, bias=False)
    nn.init.uniform_(layer.weight, -(coarse**-0.5), coarse**-0.5)  # fan-in `coarse`; torch's is 4 `fine`
    return layer


def stage(count: int, width: int) -> nn.Sequential:
    """`count` residual blocks of two convolutions, with `width` channels."""
    bodies = (nn.Sequential(conv(width, width), nn.ReLU(inplace=True), conv(width, width)) for _ in range(count))
    return nn.Sequential(*map(Residual, bodies))


class Network(nn.Module):
    """Estimates the noise of grey frames, clipped to ``LIMIT * level``; ``x - network(x, level)`` is the denoiser.

    Pixel unshuffling and the map of the noise level are from FFDNet (Zhang, Zuo & Zhang, 2018). The residual U-net
    without biases, which is scale-equivariant, is from DRUNet (Zhang et al., 2021).
    """

    def __init__(self, architecture: Architecture = SMALL):
        super().__init__()
        self.architecture = architecture
        widths, blocks = architecture.widths, architecture.blocks
        self.head = conv(4 + 1, widths[0])
        self.down = nn.ModuleList(stage(*scale) for scale in zip(blocks, widths))
        self.up = nn.ModuleList(stage(*scale) for scale in zip(blocks[:-1], widths))
        self.shrink = nn.ModuleList(conv(fine, coarse, 2, 2) for fine, coarse in pairwise(widths))
        self.grow = nn.ModuleList(enlargement(fine, coarse) for fine, coarse in pairwise(widths))
        self.tail = conv(widths[0], 4)
        nn.init.zeros_(self.tail.weight)

    def forward(self, x: torch.Tensor, level: torch.Tensor) -> torch.Tensor:
        """Noise of frames x (N, H, W), float32; `level` is its standard deviation in each pixel, of the same shape."""
        height, width = x.shape[1:]
        blocks = F.pixel_unshuffle(self._pad(x)[:, None], 2), F.avg_pool2d(self._pad(level)[:, None], 2)
        noise = F.pixel_shuffle(self.of_blocks(torch.cat(blocks, 1)), 2)[:, 0, :height, :width]
        return torch.minimum(torch.maximum(noise, -LIMIT * level), LIMIT * level)

    def of_blocks(self, seen: torch.Tensor) -> torch.Tensor:
        """Noise (N, 4, h, w) of blocks of 2 x 2 pixels, not clipped; `seen` (N, 5, h, w) is these and their level.

        The first layer is computed in float32: in bfloat16 a value of 0.9 has a rounding error of up to 0.002, which
        is comparable to weak noise.
        """
        device = seen.device.type
        with torch.autocast(device, enabled=False):
            h = self.head(seen.contiguous(memory_format=torch.channels_last))
        h, skips = h.to(torch.get_autocast_dtype(device)) if torch.is_autocast_enabled(device) else h, []
        for blocks, shrink in zip(self.down, self.shrink):
            skips.append(blocks(h))
            h = shrink(skips[-1])
        h = self.down[-1](h)
        for blocks, grow in zip(reversed(self.up), reversed(self.grow)):
            h = blocks(skips.pop() + grow(h))
        return self.tail(h).float()

    def _pad(self, x: torch.Tensor) -> torch.Tensor:
        """Pad the last two dimensions, of any size, to the next multiple by reflection."""
        for axis in (-2, -1):
            if x.shape[axis] % self.architecture.multiple:
                x = x.index_select(axis, continued(x.shape[axis], self.architecture.multiple, x.device))
        return x
