"""ADMM-net: some iterations of ADMM with a network of its own as the prior of each."""

from __future__ import annotations

import torch
from torch import nn
from torch.nn import functional

from ofanet_init.amplifier import normalised
from ofanet_init.baselines.config import BaselineConfig
from ofanet_init.blocks import activation, chain, convolution, zero_initialised

STAGES = 5  # iterations
WIDTHS = (32, 64, 128)  # channels at each scale of a prior
OUTPUTS = 3  # last estimates that the loss sees
GAMMA = -3.0  # initial value before the softplus, which gives 0.05


class ADMMNet(nn.Module):
    """Unrolled ADMM: a projection in closed form, a network as the prior, and the multiplier, in each stage.

    ::

        x <- v + C (y - sum C v) / (gram + gamma),  v = theta + b
        theta <- prior(x - b)
        b <- b - (x - theta)

    It starts from the energy-normalised measurement. `gamma` is learned for each stage.

    It differs from the published network in these points. Ma et al. learn transforms across the frames and their
    shrinkage by three convolutions, in 11 stages. Here, as in the public code of Meng et al., the prior of a stage is a
    U-net of three scales, with 5 stages instead of 9. The first estimate there is the transposed operator's. The
    activation is a leaky ReLU.

    References
    ----------
    J. Ma, X.-Y. Liu, Z. Shou & X. Yuan, "Deep tensor ADMM-net for snapshot compressive imaging", ICCV 2019.
    Z. Meng, S. Jalali & X. Yuan, "GAP-net for snapshot compressive imaging", 2020.
    Released code: github.com/mengziyi64/ADMM-net.
    """

    model, title = "admm-net", "ADMM-net"
    multiple = 2 ** (len(WIDTHS) - 1)

    def __init__(self, config: BaselineConfig):
        super().__init__()
        self.config = config
        self.priors = nn.ModuleList(Prior(config.planes) for _ in range(STAGES))
        self.gamma = nn.Parameter(torch.full((STAGES,), GAMMA))

    def forward(self, y: torch.Tensor, masks: torch.Tensor) -> list[torch.Tensor]:
        """Decode y (N, H, W) through masks (N, V, B, H, W); returns the last three estimates, (N, V, B, H, W) each."""
        gram = masks.square().sum((1, 2))
        theta = normalised(y, masks)[:, None].expand_as(masks)
        b = torch.zeros_like(masks)
        estimates = []
        for prior, gamma in zip(self.priors, functional.softplus(self.gamma)):
            v = theta + b
            x = v + masks * ((y - (masks * v).sum((1, 2))) / (gram + gamma))[:, None, None]
            theta = prior((x - b).flatten(1, 2)).unflatten(1, masks.shape[1:3])
            b = b - (x - theta)
            estimates.append(theta)
        return estimates[-OUTPUTS:]


class Prior(nn.Module):
    """A U-net of three scales from frames (N, V B, H, W) to their correction, which it adds."""

    def __init__(self, planes: int):
        super().__init__()
        fine, middle, coarse = WIDTHS
        rising = (coarse, middle), (middle, fine)
        self.down = nn.ModuleList(pair(*sizes) for sizes in ((planes, fine), (fine, middle), (middle, coarse)))
        self.grow = nn.ModuleList(nn.Sequential(nn.ConvTranspose2d(*sizes, 2, 2), activation()) for sizes in rising)
        self.up = nn.ModuleList(pair(2 * width, width) for width in (middle, fine))
        self.tail = nn.Sequential(convolution(fine, planes, 1))
        zero_initialised(self.tail)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Denoise x (N, V B, H, W)."""
        h, skips = self.down[0](x), []
        for encode in list(self.down)[1:]:
            skips.append(h)
            h = encode(functional.max_pool2d(h, 2))
        for grow, decode in zip(self.grow, self.up):
            h = decode(torch.cat([grow(h), skips.pop()], 1))
        return x + torch.tanh(self.tail(h).float())


def pair(inputs: int, width: int) -> nn.Sequential:
    """Two convolutions, each with its activation."""
    return chain(inputs, (3, width), (3, width))
