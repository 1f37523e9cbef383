"""Fused convolution, bias, activation and residual on a CPU, by oneDNN.

As separate operations, each of them reads and writes all values again. In small networks this takes as long as the
convolutions.

This module imports torch; :mod:`pnp_sci` imports it on first use only.
"""

from __future__ import annotations

import platform
from functools import cache

import numpy as np
import torch
from torch import nn

from pnp_sci.accel import winograd

RECTIFIERS = {nn.ReLU: "relu", nn.LeakyReLU: "leaky_relu"}


class Residual(nn.Module):
    """Residual block ``x + body(x)``; the body ends with a convolution."""

    def __init__(self, body: nn.Sequential):
        super().__init__()
        self.body = body

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Map (N, C, H, W) to the same shape."""
        *before, last = self.body
        h = x
        for layer in before:
            h = layer(h)
        return last(h, x) if isinstance(last, Fused) else last(h).add_(x)


class Fused(nn.Module):
    """A convolution fused with an activation or with the addition of a residual; for inference only.

    Parameters
    ----------
    layer : nn.Conv2d
        Convolution whose weights are copied.
    rectifier : nn.ReLU, nn.LeakyReLU or None
        Activation that follows it.
    dtype : torch.dtype
        Of the weights and the result.
    """

    weight: torch.Tensor
    bias: torch.Tensor | None

    def __init__(self, layer: nn.Conv2d, rectifier: nn.Module | None, dtype: torch.dtype):
        super().__init__()
        self.register_buffer("weight", layer.weight.detach().to(dtype, memory_format=torch.channels_last))
        self.register_buffer("bias", None if layer.bias is None else layer.bias.detach().to(dtype))
        self.geometry = layer.padding, layer.stride, layer.dilation, layer.groups
        reach = layer.dilation[1] * (layer.kernel_size[1] - 1) + 1 - 2 * int(layer.padding[1])
        self.two = layer.stride[1] + reach if layer.stride != (1, 1) else 0  # least width of x for two columns
        kind = "none" if rectifier is None else RECTIFIERS[type(rectifier)]
        self.rectifier = kind, [rectifier.negative_slope] if isinstance(rectifier, nn.LeakyReLU) else [], ""

    def forward(self, x: torch.Tensor, added: torch.Tensor | None = None) -> torch.Tensor:
        """Convolve x (N, C, H, W); `added`, of the shape of the result, is added to it.

        With strides, oneDNN gives arbitrary values where the result is a single column of bfloat16 on CPUs with AMX. So
        it makes two columns.
        """
        dtype = self.weight.dtype
        layer = self.weight, self.bias, *self.geometry
        convolve = torch.ops.mkldnn._convolution_pointwise
        if x.shape[-1] < self.two:
            assert added is None, "what a stride has made smaller has no sum"
            return self(nn.functional.pad(x, (0, self.two - x.shape[-1])))[..., :1]
        if added is None:
            return convolve(x.to(dtype), *layer, *self.rectifier)
        assert self.rectifier[0] == "none", "no activation may follow a sum"
        return convolve.binary(x.to(dtype), added.to(dtype), *layer, "add", 1.0, None, [], None)


class Winograd(Fused):
    """A fused 3 x 3 convolution by Winograd's algorithm, in float32; arguments as for :class:`Fused`."""

    spectra: torch.Tensor
    shift: torch.Tensor

    def __init__(self, layer: nn.Conv2d, rectifier: nn.Module | None, dtype: torch.dtype):
        super().__init__(layer, rectifier, dtype)
        assert layer.out_channels % winograd.COLUMNS == 0 <= layer.out_channels - 16, layer
        self.register_buffer("spectra", torch.from_numpy(winograd.spectra(self.weight.numpy())))
        none = torch.zeros(layer.out_channels, dtype=torch.float32)
        self.register_buffer("shift", none if self.bias is None else self.bias)
        kind, slopes, _ = self.rectifier
        self.slope = {"none": 1.0, "relu": 0.0, "leaky_relu": sum(slopes)}[kind]

    @staticmethod
    def serves(layer: nn.Conv2d, dtype: torch.dtype) -> bool:
        """Whether this is faster for `layer` on this CPU; with AVX-512 or half precision, oneDNN is faster."""
        like_that = layer.kernel_size == (3, 3) and layer.padding == layer.stride == layer.dilation == (1, 1)
        wide = layer.in_channels >= 32 and layer.out_channels >= 16 and layer.out_channels % winograd.COLUMNS == 0
        narrow = torch.backends.cpu.get_cpu_capability() == "AVX2" and dtype == torch.float32
        return narrow and like_that and wide and layer.groups == 1

    def forward(self, x: torch.Tensor, added: torch.Tensor | None = None) -> torch.Tensor:
        """Convolve x (N, C, H, W); `added`, of the shape of the result, is added to it."""
        assert added is None or self.rectifier[0] == "none", "no activation may follow a sum"
        lines = _lines(x)
        out = np.empty((*lines.shape[:3], self.shift.shape[0]), np.float32)
        more = out[:0] if added is None else _lines(added)
        winograd.convolve(lines, self.spectra.numpy(), self.shift.numpy(), np.float32(self.slope), more, out)
        return torch.from_numpy(out).permute(0, 3, 1, 2)


def _lines(x: torch.Tensor) -> np.ndarray:
    """Convert (N, C, H, W) to (N, H, W, C), float32; a copy unless x is in channels-last memory format."""
    return np.ascontiguousarray(x.detach().float().permute(0, 2, 3, 1).numpy())


def fuse(network: nn.Module, dtype: torch.dtype) -> None:
    """Replace the convolutions in all sequences and lists of a network on the CPU by fused ones, for inference only.

    Does nothing where this version of torch or this processor does not support it.
    """
    if not _can_fuse(dtype):
        return
    for sequence in [module for module in network.modules() if isinstance(module, (nn.Sequential, nn.ModuleList))]:
        for i, layer in enumerate(sequence):
            if isinstance(layer, nn.Conv2d) and layer.padding_mode == "zeros" and not isinstance(layer.padding, str):
                follows = sequence[i + 1] if isinstance(sequence, nn.Sequential) and i + 1 < len(sequence) else None
                rectifier = follows if type(follows) in RECTIFIERS else None
                sequence[i] = (Winograd if Winograd.serves(layer, dtype) else Fused)(layer, rectifier, dtype)
                if rectifier is not None:
                    sequence[i + 1] = nn.Identity()


@cache
def _can_fuse(dtype: torch.dtype) -> bool:
    """Whether the fused operators, which are private to torch, exist on this x86-64 CPU and give the right result."""
    if platform.machine().lower() not in ("x86_64", "amd64") or not torch.backends.mkldnn.is_available():
        return False
    x = torch.linspace(-1, 1, 8 * 8 * 8).sin().reshape(1, 8, 8, 8).to(dtype)
    tolerance = 1e-4 if dtype == torch.float32 else 0.03
    with torch.random.fork_rng(devices=[]), torch.inference_mode():
        torch.manual_seed(0)
        layers = nn.Conv2d(8, 8, 3, padding=1), nn.LeakyReLU(0.5), nn.Conv2d(8, 8, 1)
        first, rectifier, last = layers
        try:
            fused = Residual(nn.Sequential(Fused(first, rectifier, dtype), Fused(last, None, dtype)))(x)
            apart = Residual(nn.Sequential(*layers).to(dtype))(x)
        except (AttributeError, RuntimeError, TypeError):
            return False
    return torch.allclose(fused, apart, rtol=tolerance, atol=tolerance)
