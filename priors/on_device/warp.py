"""Frames along a flow, on tensors."""

from __future__ import annotations

import torch
import torch.nn.functional as F


def bicubic(frames: torch.Tensor, flow: torch.Tensor) -> torch.Tensor:
    """Frames (N, H, W) at each pixel displaced by flow (N, 2, H, W), columns and rows; edges are replicated.

    The kernel is that of Catmull and Rom. Cubic convolution is linear in its parameter A: theirs, A = -1/2, is two
    thirds of torch's, A = -3/4, and a third of A = 0. The latter is linear interpolation with ``3 t^2 - 2 t^3``.

    >>> ramp = torch.arange(8.0).expand(1, 8, 8)
    >>> round(float(bicubic(ramp, torch.full((1, 2, 8, 8), 0.25))[0, 3, 3]), 5)
    3.25
    """
    across, down = _places(flow)
    cubic = _sampled(frames, across, down, "bicubic")
    return (2 * cubic + _sampled(frames, _smoothed(across), _smoothed(down), "bilinear")) / 3


def _places(flow: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Columns and rows (N, H, W) that a flow points to, within the frame."""
    rows, columns = flow.shape[-2:]
    across = torch.arange(columns, device=flow.device) + flow[:, 0]
    down = torch.arange(rows, device=flow.device)[:, None] + flow[:, 1]
    return across.clamp(0, columns - 1), down.clamp(0, rows - 1)


def _smoothed(places: torch.Tensor) -> torch.Tensor:
    whole = places.floor()
    t = places - whole
    return whole + t * t * (3 - 2 * t)


def _sampled(frames: torch.Tensor, across: torch.Tensor, down: torch.Tensor, mode: str) -> torch.Tensor:
    rows, columns = frames.shape[-2:]
    grid = torch.stack([2 * across / (columns - 1) - 1, 2 * down / (rows - 1) - 1], -1)
    return F.grid_sample(frames[:, None], grid.to(frames), mode, "border", align_corners=True)[:, 0]
