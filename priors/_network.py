"""The network behind the learned priors: a small U-net that sees neighbouring frames and is told its noise level.

This module imports torch; the priors import it on their first call.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import nn

LIMIT = 6.0  # no pixel moves by more standard deviations than this: white noise exceeds it once in 5e8 pixels


@dataclass(frozen=True)
class Architecture:
    """What defines a network.

    Parameters
    ----------
    widths, blocks : tuple of int
        Channels and residual blocks of each scale, finest first.
    window : int
        Frames either side that enter the first layer.
    taken : float
        Part of its channels that each residual block takes from the frame before, and as much from the frame after;
        0 keeps frames apart.
    """

    widths: tuple[int, ...]
    blocks: tuple[int, ...]
    window: int = 0
    taken: float = 0.0

    @property
    def alone(self) -> bool:
        """Whether each frame is denoised on its own."""
        return self.window == 0 and self.taken == 0

    @property
    def multiple(self) -> int:
        """Height and width are padded to a multiple of this: the unshuffling, then one halving a further scale."""
        return 2 ** len(self.widths)


ARCHITECTURES = {
    "video": Architecture(widths=(32, 64, 128), blocks=(1, 2, 2), window=2, taken=0.25),
    "ffdnet": Architecture(widths=(32, 48, 64), blocks=(1, 1, 2)),
}


def reflected(index: torch.Tensor, length: int) -> torch.Tensor:
    """Bring any index into 0..length-1 by reflection about the first and the last element.

    >>> reflected(torch.arange(-2, 5), 3).tolist()
    [2, 1, 0, 1, 2, 1, 0]
    """
    period = max(2 * (length - 1), 1)
    folded = index.remainder(period)
    return torch.minimum(folded, period - folded).clamp(max=length - 1)


class Shift(torch.autograd.Function):
    """Take the first `taken` channels from the frame before and the next `taken` from the frame after.

    x is (V * B, C, H, W). A view's first frame has none before it and keeps its own channels, as does the last. Slices
    copied in place are several times quicker on a CPU than the operations that autograd would need.
    """

    @staticmethod
    def forward(ctx, x, views, taken):
        ctx.views, ctx.taken = views, taken
        out = x.clone()
        old, new = x.unflatten(0, (views, -1)), out.unflatten(0, (views, -1))
        new[:, 1:, :taken] = old[:, :-1, :taken]
        new[:, :-1, taken : 2 * taken] = old[:, 1:, taken : 2 * taken]
        return out

    @staticmethod
    def backward(ctx, gradient):  # type: ignore[override]
        taken = ctx.taken
        out = gradient.clone()
        old, new = gradient.unflatten(0, (ctx.views, -1)), out.unflatten(0, (ctx.views, -1))
        if old.shape[1] > 1:
            new[:, :-1, :taken] = old[:, 1:, :taken]
            new[:, -1, :taken] = 0
            new[:, 0, :taken] += old[:, 0, :taken]
            new[:, 1:, taken : 2 * taken] = old[:, :-1, taken : 2 * taken]
            new[:, 0, taken : 2 * taken] = 0
            new[:, -1, taken : 2 * taken] += old[:, -1, taken : 2 * taken]
        return out, None, None


def conv(inputs: int, outputs: int, size: int = 3, stride: int = 1) -> nn.Conv2d:
    """Convolution without a bias: the network then scales with its input, D(a x, a sigma) = a D(x, sigma)."""
    return nn.Conv2d(inputs, outputs, size, stride, padding=(size - 1) // 2, bias=False)


class Block(nn.Module):
    """Residual block of two convolutions; part of its input comes from the neighbouring frames."""

    def __init__(self, width: int, taken: float):
        super().__init__()
        self.taken = int(width * taken)
        self.first, self.second = conv(width, width), conv(width, width)

    def forward(self, x: torch.Tensor, views: int) -> torch.Tensor:
        seen = Shift.apply(x, views, self.taken) if self.taken else x
        return x + self.second(F.relu(self.first(seen), inplace=True))


class Stage(nn.ModuleList):
    """Residual blocks of one scale."""

    def __init__(self, count: int, width: int, taken: float):
        super().__init__(Block(width, taken) for _ in range(count))

    def forward(self, x: torch.Tensor, views: int) -> torch.Tensor:
        for block in self:
            x = block(x, views)
        return x


class Network(nn.Module):
    """Estimates the noise in grey frames, bounded by ``LIMIT * sigma``: a denoiser is ``x - network(x, sigma)``.

    Pixel-unshuffling by two and a map of the noise level come from FFDNet (Zhang, Zuo & Zhang, 2018), scale-equivariant
    residual U-nets without biases from DRUNet (Zhang et al., 2021), and the exchange of channels between neighbouring
    frames from the temporal shift module (Lin, Gan & Han, 2019; for denoising: Qi et al., BSVD, 2022).
    """

    def __init__(self, architecture: Architecture):
        super().__init__()
        self.architecture = architecture
        widths, blocks, taken = architecture.widths, architecture.blocks, architecture.taken
        self.head = conv(4 * (2 * architecture.window + 1) + 1, widths[0])
        self.down = nn.ModuleList(Stage(*scale, taken) for scale in zip(blocks, widths))
        self.up = nn.ModuleList(Stage(*scale, taken) for scale in zip(blocks[:-1], widths))
        self.shrink = nn.ModuleList(conv(fine, coarse, 2, 2) for fine, coarse in pairwise(widths))
        self.grow = nn.ModuleList(conv(coarse, 4 * fine, 1) for fine, coarse in pairwise(widths))
        self.tail = conv(widths[0], 4)
        nn.init.zeros_(self.tail.weight)

    def forward(self, x: torch.Tensor, sigma: torch.Tensor) -> torch.Tensor:
        """Noise (V, B, H, W) in x (V, B, H, W), both float32; sigma (V,) is its standard deviation in each view."""
        views, _, height, width = x.shape
        bound = LIMIT * sigma[:, None, None, None]
        padded = self._pad(x)
        h, skips = self._see(padded, sigma), []
        for stage, shrink in zip(self.down, self.shrink):
            skips.append(stage(h, views))
            h = shrink(skips[-1])
        h = self.down[-1](h, views)
        for stage, grow in zip(reversed(self.up), reversed(self.grow)):
            h = stage(skips.pop() + F.pixel_shuffle(grow(h), 2), views)
        noise = F.pixel_shuffle(self.tail(h).float(), 2).reshape(padded.shape)[..., :height, :width]
        return torch.minimum(torch.maximum(noise, -bound), bound)

    def _pad(self, x: torch.Tensor) -> torch.Tensor:
        """Extend the last two dimensions to the next multiple by reflection, whatever their size."""
        for axis in (-2, -1):
            size, multiple = x.shape[axis], self.architecture.multiple
            if size % multiple:
                padded = torch.arange(-(-size // multiple) * multiple, device=x.device)
                x = x.index_select(axis, reflected(padded, size))
        return x

    def _see(self, x: torch.Tensor, sigma: torch.Tensor) -> torch.Tensor:
        """First layer: every frame with its window of neighbours and its noise level, in full precision.

        Rounded to bfloat16, a pixel of 0.9 is off by up to 0.002: half of a faint noise would be the rounding's own.
        """
        views, frames = x.shape[:2]
        window, device = self.architecture.window, x.device.type
        pixels = F.pixel_unshuffle(x.reshape(-1, 1, *x.shape[2:]), 2).unflatten(0, (views, frames))
        times = torch.arange(frames, device=x.device)
        seen = [pixels[:, reflected(times + step, frames)] for step in range(-window, window + 1)]
        seen.append(sigma[:, None, None, None, None].expand(views, frames, 1, *pixels.shape[3:]))
        with torch.autocast(device, enabled=False):
            h = self.head(torch.cat(seen, 2).flatten(0, 1).contiguous(memory_format=torch.channels_last))
        return h.to(torch.get_autocast_dtype(device)) if torch.is_autocast_enabled(device) else h
