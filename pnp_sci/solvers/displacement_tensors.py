"""Displacement of frames on tensors.

This module imports torch; it is imported on first use only.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F


def displace(x: torch.Tensor, v: torch.Tensor, ridge: float, reach: int, farthest: float) -> None:
    """As :func:`pnp_sci.solvers.displacement.displace`, view by view."""
    for estimate, pulled in zip(x, v):
        down, across = _slopes(estimate)
        b = pulled - estimate
        products = torch.stack([down * down, down * across, across * across, down * b, across * b])
        means = F.avg_pool2d(products, 2, ceil_mode=True, divisor_override=4)
        for _ in range(2):
            means = F.avg_pool2d(F.pad(means, 4 * (reach,), mode="replicate"), 2 * reach + 1, stride=1)
        aa, ac, cc, ab, cb = means
        aa, cc = aa + ridge, cc + ridge
        below = aa * cc - ac * ac
        inverse = torch.where(below > 0, 1 / below, 0)
        moved = torch.stack([cc * ab - ac * cb, aa * cb - ac * ab]) * inverse
        moved = moved / (moved.square().sum(0).sqrt() / farthest).clamp(min=1)
        height, width = estimate.shape[1:]
        moved = moved.repeat_interleave(2, 2).repeat_interleave(2, 3)[..., :height, :width]
        pulled += down * moved[0] + across * moved[1]


def _slopes(frames: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Gradients of frames (B, H, W), down and across, by central differences of frames with replicated edges."""
    padded = F.pad(frames[:, None], (1, 1, 1, 1), mode="replicate")[:, 0]
    return (padded[:, 2:, 1:-1] - padded[:, :-2, 1:-1]) / 2, (padded[:, 1:-1, 2:] - padded[:, 1:-1, :-2]) / 2
