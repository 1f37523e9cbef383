"""Convolutions on a CPU at once with what follows them: oneDNN adds the bias, rectifies and sums in passing.

Apart, these read and write all values once more each, which takes small networks as long as the convolutions do.
"""

from __future__ import annotations

from functools import cache

import torch
from torch import nn


class Residual(nn.Module):
    """``x + body(x)``; the body ends with a convolution."""

    def __init__(self, body: nn.Sequential):
        super().__init__()
        self.body = body

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """(N, C, H, W) -> the same shape."""
        *before, last = self.body
        h = x
        for layer in before:
            h = layer(h)
        return last(h, x) if isinstance(last, Fused) else last(h).add_(x)


class Fused(nn.Module):
    """A convolution and the rectifier behind it, if any, at once; without one, x may be added. Nothing learns here."""

    def __init__(self, layer: nn.Conv2d, rectifier: nn.Module | None, dtype: torch.dtype):
        super().__init__()
        self.dtype = dtype
        self.weight = layer.weight.detach().to(dtype, memory_format=torch.channels_last)
        self.bias = None if layer.bias is None else layer.bias.detach().to(dtype)
        self.geometry = layer.padding, layer.stride, layer.dilation, layer.groups
        kinds = {nn.ReLU: "relu", nn.LeakyReLU: "leaky_relu", type(None): "none"}
        slope = [rectifier.negative_slope] if isinstance(rectifier, nn.LeakyReLU) else []
        self.rectifier = kinds[type(rectifier)], slope, ""

    def forward(self, x: torch.Tensor, added: torch.Tensor | None = None) -> torch.Tensor:
        """(N, C, H, W), and what is to be added to the result, of its shape -> the result."""
        layer, x = (self.weight, self.bias, *self.geometry), x.to(self.dtype)
        convolve = torch.ops.mkldnn._convolution_pointwise
        if added is None:
            return convolve(x, *layer, *self.rectifier)
        return convolve.binary(x, added.to(self.dtype), *layer, "add", 1.0, None, [], None)


def fuse(network: nn.Module, dtype: torch.dtype) -> None:
    """Fuse, where torch can, the convolutions in all sequences of a network on the CPU, which then learns no more."""
    if not _can_fuse(dtype):
        return
    for sequence in [module for module in network.modules() if isinstance(module, nn.Sequential)]:
        for i, layer in enumerate(sequence):
            if isinstance(layer, nn.Conv2d):
                follows = sequence[i + 1] if i + 1 < len(sequence) else None
                rectifier = follows if isinstance(follows, (nn.ReLU, nn.LeakyReLU)) else None
                sequence[i] = Fused(layer, rectifier, dtype)
                if rectifier is not None:
                    sequence[i + 1] = nn.Identity()


@cache
def _can_fuse(dtype: torch.dtype) -> bool:
    """Whether this torch has what is private to it, and that does what it should."""
    layers = nn.Conv2d(2, 2, 3, padding=1), nn.LeakyReLU(0.1), nn.Conv2d(2, 2, 1)
    x = torch.linspace(-1, 1, 2 * 8 * 8).reshape(1, 2, 8, 8).to(dtype)
    try:
        with torch.inference_mode():
            fused = Residual(nn.Sequential(Fused(*layers[:2], dtype), Fused(layers[2], None, dtype)))(x)
            apart = Residual(nn.Sequential(*layers).to(dtype))(x)
    except (AttributeError, RuntimeError, TypeError):
        return False
    return torch.allclose(fused, apart, rtol=0.05, atol=0.05)
