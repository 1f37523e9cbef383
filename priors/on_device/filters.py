"""Filters of pictures, tensors (..., H, W), whose edges are replicated, and of still pixels along time."""

from __future__ import annotations

import numpy as np
import torch
import torch.nn.functional as F

from priors.kernels.still import HARDLY


def box(pictures: torch.Tensor, side: int, times: int = 1) -> torch.Tensor:
    """Mean over squares of `side` pixels, an odd number, applied so many times.

    >>> round(box(torch.eye(3), 3)[1, 1].item(), 5)
    0.33333
    """
    flat = pictures.reshape(-1, 1, *pictures.shape[-2:])
    for _ in range(times):
        flat = F.avg_pool2d(F.pad(flat, (side // 2,) * 4, mode="replicate"), side, stride=1)
    return flat.reshape(pictures.shape)


def gaussian(pictures: torch.Tensor, width: float) -> torch.Tensor:
    """Gaussian of standard deviation `width` in pixels, cut off after four of them.

    >>> round(float(gaussian(torch.ones(1, 8, 8), 1.5).mean()), 5)
    1.0
    """
    reach = int(4 * width + 0.5)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / width) ** 2)
    weights /= weights.sum()
    for axis in (-2, -1):
        size = pictures.shape[axis]
        places = torch.arange(size, device=pictures.device)
        total = torch.zeros_like(pictures)
        for shift, weight in zip(range(-reach, reach + 1), weights):
            total.add_(pictures.index_select(axis, (places + shift).clamp(0, size - 1)), alpha=float(weight))
        pictures = total
    return pictures


def tie(x: torch.Tensor, still: torch.Tensor, out: torch.Tensor) -> torch.Tensor:
    """``out + still (mean over frames of x - out)`` for x and out (V, B, H, W) and still (V, 1, H, W)."""
    counts = torch.where(still.amax(-1, keepdim=True) < HARDLY, 0, still)
    return out + counts * (x.mean(1, keepdim=True) - out)
