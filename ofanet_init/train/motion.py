"""Pairs of pictures with known motion: a background with affine and elastic motion, and a moving layer before it."""

from __future__ import annotations

import torch
from torch.nn import functional

from ofanet_init.flow import warped

LARGEST = 12.0  # pixels: scale of the largest motion


def pairs(frames: torch.Tensor, random: torch.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """First and second pictures (N/2, 1, H, W) and the flow (N/2, 2, H, W) between them, from N pictures (N, H, W).

    The first picture is the second one warped, ``first(p) = second(p + flow(p))``, so the flow is exact. Half of the N
    pictures are backgrounds. The others are foreground layers, cut out by smooth random shapes. Noise is added to both
    pictures, as the estimates of a video have errors.
    """
    back, front = frames[:, None].chunk(2)
    shape = smooth(random, len(back), 1, frames.shape[-1], 6) > 0.25
    behind, before = motion(random, len(back), frames.shape[-1]), motion(random, len(back), frames.shape[-1])
    covered = warped(shape.float(), before) > 0.5
    second = torch.where(shape, front, back)
    first = torch.where(covered, warped(front, before), warped(back, behind))
    level = 0.1 * torch.rand(len(back), 1, 1, 1, device=frames.device, generator=random)
    first, second = (spoiled(picture, level, random) for picture in (first, second))
    return first, second, torch.where(covered, before, behind)


def spoiled(picture: torch.Tensor, level: torch.Tensor, random: torch.Generator) -> torch.Tensor:
    """A picture (N, 1, H, W) with partly correlated noise of standard deviation about `level` (N, 1, 1, 1)."""
    noise = torch.randn(picture.shape, device=picture.device, generator=random)
    return picture + 1.5 * level * functional.avg_pool2d(noise, 3, 1, 1) + 0.5 * level * noise


def motion(random: torch.Generator, samples: int, size: int) -> torch.Tensor:
    """Smooth random flows (N, 2, H, W): the sum of a shift, an affine and an elastic part; most are slow."""
    device = random.device
    strength = torch.rand(samples, 1, 1, 1, device=device, generator=random) ** 2
    shift = torch.randn(samples, 2, 1, 1, device=device, generator=random)
    turn = torch.randn(samples, 2, 2, device=device, generator=random)
    ramp = torch.linspace(-1, 1, size, device=device)
    grid = torch.stack(torch.meshgrid(ramp, ramp, indexing="xy"))
    affine = torch.einsum("nij,jhw->nihw", turn, grid)
    elastic = smooth(random, samples, 2, size, 5)
    return LARGEST * strength * (0.5 * shift + 0.25 * affine + 0.5 * elastic)


def smooth(random: torch.Generator, samples: int, channels: int, size: int, cells: int) -> torch.Tensor:
    """Smooth random fields (N, C, H, W) of variance about 1, interpolated from `cells` x `cells` values."""
    coarse = torch.randn(samples, channels, cells, cells, device=random.device, generator=random)
    return functional.interpolate(coarse, size=(size, size), mode="bicubic", align_corners=True)


def pyramid_loss(flows: list[torch.Tensor], truth: torch.Tensor) -> torch.Tensor:
    """Sum over scales of the mean end-point error in pixels; each scale has half the weight of the next finer one."""
    loss = truth.new_zeros(())
    for level, flow in enumerate(reversed(flows)):
        scaled = functional.avg_pool2d(truth, truth.shape[-1] // flow.shape[-1])
        loss = loss + 0.5**level * end_point_error(flow, scaled)
    return loss


def end_point_error(flow: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Mean end-point error in pixels between flows (N, 2, H, W)."""
    return (flow.float() - truth).square().sum(1).add(1e-6).sqrt().mean()
