"""Optical flow between frames by a compact network, and warping along it."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from ofanet_init.blocks import activation, convolution

WIDTHS = (24, 48, 72, 96, 128)  # channels at 1/2, 1/4, 1/8, 1/16 and 1/32 of the resolution
COARSEST = 2 ** len(WIDTHS)


class FlowNet(nn.Module):
    """Encoder-decoder after FlowNet (Dosovitskiy et al. 2015); the flow at each scale refines the coarser one.

    Flows are in pixels, (columns, rows): a point at p in the first frame is at p + flow(p) in the second.
    """

    def __init__(self) -> None:
        super().__init__()
        inputs = (2, *WIDTHS[:-1])
        self.encoder = nn.ModuleList(
            nn.Sequential(
                convolution(i, o, 5 if i == 2 else 3, stride=2), activation(), convolution(o, o, 3), activation()
            )
            for i, o in zip(inputs, WIDTHS)
        )
        coarser = (0, *(w + 2 for w in WIDTHS[:0:-1]))
        self.decoder = nn.ModuleList(
            nn.Sequential(convolution(w + c, w, 3), activation(), convolution(w, w, 3), activation())
            for w, c in zip(WIDTHS[::-1], coarser)
        )
        self.predict = nn.ModuleList(convolution(w, 2, 3) for w in WIDTHS[::-1])
        for layer in self.predict:
            nn.init.zeros_(layer.weight)  # type: ignore[arg-type]  # initialised with zero flow
            nn.init.zeros_(layer.bias)  # type: ignore[arg-type]

    def forward(self, first: torch.Tensor, second: torch.Tensor) -> list[torch.Tensor]:
        """Flows at 1/32, 1/16, 1/8, 1/4 and 1/2 of the resolution, in full-resolution pixels; H, W multiples of 32."""
        x = torch.cat([first, second], 1) - 0.5
        features = []
        for layer in self.encoder:
            x = layer(x)
            features.append(x)
        flows: list[torch.Tensor] = []
        above = None
        for feature, layer, predict in zip(features[::-1], self.decoder, self.predict):
            if above is not None:
                feature = torch.cat([feature, enlarged(above, 2), enlarged(flows[-1], 2) / 10], 1)
            above = layer(feature)
            step = 10 * predict(above).float()
            flows.append(enlarged(flows[-1], 2) + step if flows else step)
        return flows

    def flow(self, first: torch.Tensor, second: torch.Tensor) -> torch.Tensor:
        """Flow (N, 2, H, W) from the first to the second frames (N, 1, H, W), of any size."""
        height, width = first.shape[2:]
        padding = (0, -width % COARSEST, 0, -height % COARSEST)
        pair = (functional.pad(frame, padding, "replicate") for frame in (first, second))
        return enlarged(self(*pair)[-1], 2)[:, :, :height, :width]


def enlarged(x: torch.Tensor, factor: int) -> torch.Tensor:
    """Bilinear interpolation of (N, C, H, W) to `factor` times the height and width."""
    return functional.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


def warped(x: torch.Tensor, flow: torch.Tensor) -> torch.Tensor:
    """Backward warping of x (N, C, H, W) by a flow (N, 2, H, W): ``out(p) = x(p + flow(p))``, edges repeated."""
    height, width = x.shape[2:]
    rows = torch.arange(height, device=x.device, dtype=flow.dtype)[:, None]
    columns = torch.arange(width, device=x.device, dtype=flow.dtype)
    grid = torch.stack([(2 * (columns + flow[:, 0]) + 1) / width - 1, (2 * (rows + flow[:, 1]) + 1) / height - 1], -1)
    fetched = functional.grid_sample(x.float(), grid.float(), padding_mode="border", align_corners=False)
    return fetched.to(x.dtype)  # float32, as bfloat16 coordinates are off by up to a pixel
