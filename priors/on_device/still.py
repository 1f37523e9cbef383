"""Still pixels on tensors."""

from __future__ import annotations

import torch

from priors.kernels.still import DARKEST, HARDLY, TUNED


def sureness(change: torch.Tensor, brightness: torch.Tensor, rest: float) -> torch.Tensor:
    """Probability that pixels are constant in time, as :func:`priors.kernels.still.sureness`."""
    r = rest * (brightness / TUNED.bright).clamp(DARKEST, 1)
    return torch.exp(-change / r**2)


def tie(x: torch.Tensor, still: torch.Tensor, out: torch.Tensor) -> torch.Tensor:
    """``out + still (mean over frames of x - out)`` for x and out (V, B, H, W) and still (V, 1, H, W)."""
    counts = torch.where(still.amax(-1, keepdim=True) < HARDLY, 0, still)
    return out + counts * (x.mean(1, keepdim=True) - out)
