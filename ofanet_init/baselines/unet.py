"""U-net: one convolutional network from the measurement to all frames."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from ofanet_init.amplifier import normalised
from ofanet_init.baselines.config import BaselineConfig
from ofanet_init.blocks import activation, chain, convolution, zero_initialised
from pnp_sci.accel.fusion import Residual

WIDTH = 64  # channels at all scales
SCALES = 5  # blocks of the encoder, and of the decoder


class UNet(nn.Module):
    """Encoder and decoder of five residual blocks each, with skip connections by addition.

    The inputs are the energy-normalised measurement and its products with the masks. The output is added to the
    energy-normalised measurement, which is the mean of all frames.

    It differs from the published network in these points. The encoder halves height and width after each block but the
    last, where the released code keeps full resolution. The normalised measurement itself is an additional input. It is
    normalised by the sum of the masks, not by that of their squares. There is no batch normalisation. The activation is
    a leaky ReLU. The output is added to the normalised measurement rather than to its products with the masks.

    References
    ----------
    M. Qiao, Z. Meng, J. Ma & X. Yuan, "Deep learning for video compressive sensing", APL Photonics 5 (2020);
    released code: github.com/mq0829/DL-CACTI, E2E_CNN.
    """

    model, title = "unet", "U-net"
    multiple = 2 ** (SCALES - 1)

    def __init__(self, config: BaselineConfig):
        super().__init__()
        self.config = config
        self.head = nn.Sequential(convolution(1 + config.planes, WIDTH, 3), activation())
        self.encoder = nn.ModuleList(block(WIDTH) for _ in range(SCALES))
        self.middle = chain(WIDTH, (3, WIDTH), (3, WIDTH))
        self.grow = nn.ModuleList(nn.ConvTranspose2d(WIDTH, WIDTH, 2, 2) for _ in range(SCALES - 1))
        self.decoder = nn.ModuleList(block(WIDTH) for _ in range(SCALES))
        self.tail = nn.Sequential(convolution(WIDTH, config.planes, 1))
        zero_initialised(self.tail)

    def forward(self, y: torch.Tensor, masks: torch.Tensor) -> list[torch.Tensor]:
        """Decode y (N, H, W) through masks (N, V, B, H, W); returns one video (N, V, B, H, W)."""
        common = normalised(y, masks)
        h = self.head(torch.cat([common, (common[:, None] * masks).flatten(1, 2)], 1))
        skips = []
        for k, encode in enumerate(self.encoder):
            h = encode(functional.max_pool2d(h, 2) if k else h)
            skips.append(h)
        h = self.middle(h)
        for k, decode in enumerate(self.decoder):
            h = decode((self.grow[k - 1](h) if k else h) + skips.pop())
        return [(common + torch.tanh(self.tail(h).float())).unflatten(1, masks.shape[1:3])]


def block(width: int) -> nn.Sequential:
    """Residual block of two convolutions, and an activation after the sum."""
    body = chain(width, (3, width), (3, width), last=False)
    zero_initialised(body)
    return nn.Sequential(Residual(body), activation())
