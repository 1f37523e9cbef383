"""Displacement of frames on tensors.

This module imports torch; it is imported on first use only.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F


def displace_tensors(x: torch.Tensor, v: torch.Tensor, ridge: float, most: float, reach: int, farthest: float) -> None:
    """As :func:`pnp_sci.solvers.displacement.displace`, frame by frame, which needs little memory.

    `ridge` is the term beside the products of gradients, `most` bounds what is added, `reach` and `farthest` are REACH
    and FARTHEST of that module.
    """
    height, width = x.shape[2:]
    for frame, pulled in zip(x.flatten(0, 1), v.flatten(0, 1)):
        down, across = _slopes(frame)
        b = pulled - frame
        products = torch.stack([down * down, down * across, across * across, down * b, across * b])
        means = F.avg_pool2d(products[None], 2, ceil_mode=True, divisor_override=4)
        for _ in range(2):
            means = F.avg_pool2d(F.pad(means, 4 * (reach,), mode="replicate"), 2 * reach + 1, stride=1)
        aa, ac, cc, ab, cb = means[0]
        aa, cc = aa + ridge, cc + ridge
        below = aa * cc - ac * ac
        moved = torch.stack([cc * ab - ac * cb, aa * cb - ac * ab]) * torch.where(below > 0, 1 / below, 0)
        moved = moved / (moved.square().sum(0).sqrt() / farthest).clamp(min=1)
        moved = moved.repeat_interleave(2, 1).repeat_interleave(2, 2)[:, :height, :width]
        pulled += (down * moved[0] + across * moved[1]).clamp(-most, most)


def _slopes(frame: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Gradient of a frame (H, W), down and across, by central differences of a frame with replicated edges."""
    padded = F.pad(frame[None, None], (1, 1, 1, 1), mode="replicate")[0, 0]
    return (padded[2:, 1:-1] - padded[:-2, 1:-1]) / 2, (padded[1:-1, 2:] - padded[1:-1, :-2]) / 2
