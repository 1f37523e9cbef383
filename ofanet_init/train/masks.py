"""Random masks for training: binary ones, and grey ones as they come from a calibration."""

from __future__ import annotations

import numpy as np
import torch

CAMERA = 0.5  # fraction of moving masks with the benchmark's step and shift, see pnp_sci.moving_masks
REACH, SHIFT = 2, 30  # pixels: largest step between frames and largest shift between views of the others
LEAK = 0.2  # fraction of masks whose closed elements transmit some light
GREY = 0.4  # fraction of moving masks whose elements are blurred, as a camera sees them
BLUR = 0.3, 0.9  # pixels: least standard deviation of that Gaussian, and what is added to it
SLOPE = 0.25, 0.75  # least slope of the transmission over a blurred pattern of variance 1, and what is added to it


def random_masks(random: torch.Generator, shape: tuple[int, int, int, int, int], independent: bool) -> torch.Tensor:
    """Random masks (N, V, B, H, W) in [0, 1]: one pattern per sample, shifted from frame to frame and view to view.

    If `independent`, the frames have independent patterns.
    """
    samples, views, frames, rows, columns = shape
    device = random.device

    def uniform(*size: int) -> torch.Tensor:
        return torch.rand(*size, device=device, generator=random)

    density = torch.where(uniform(samples) < 0.5, 0.5, 0.3 + 0.4 * uniform(samples))[:, None, None, None, None]
    closed = torch.where(uniform(samples) < LEAK, 0.2 * uniform(samples), 0.0)[:, None, None, None, None]
    if independent:
        return torch.where(uniform(*shape) < density, 1.0, closed)
    span = max(rows, columns) + 64  # the pattern is periodic
    pattern = uniform(samples, span, span)
    camera = uniform(samples) < CAMERA
    step = ((2 * REACH + 1) * uniform(samples, 2)).floor() - REACH
    shift = ((2 * SHIFT + 1) * uniform(samples, 2)).floor() - SHIFT
    step, shift = (  # numbers, not tensors, in `where`: no synchronisation with the device
        torch.stack([torch.where(camera, its, own) for its, own in zip(moves, drawn.unbind(1))], 1).long()
        for moves, drawn in (((1, -1), step), ((15, -18), shift))
    )
    v = torch.arange(views, device=device)[None, :, None, None]
    b = torch.arange(frames, device=device)[None, None, :, None]
    moved = v * shift[:, None, None] + b * step[:, None, None]  # (N, V, B, 2)
    i = (torch.arange(rows, device=device) - moved[..., :1]).remainder(span)[..., :, None]
    j = (torch.arange(columns, device=device) - moved[..., 1:]).remainder(span)[..., None, :]
    n = torch.arange(samples, device=device)[:, None, None, None, None]
    is_grey, blur, slope = (uniform(samples, 1, 1) for _ in range(3))
    density = density[..., 0, 0]
    blurred = grey(pattern, density, BLUR[0] + BLUR[1] * blur, SLOPE[0] + SLOPE[1] * slope)
    pattern = torch.where(is_grey < GREY, blurred, (pattern < density).float())
    return closed + (1 - closed) * pattern[n, i, j]


def grey(pattern: torch.Tensor, density: torch.Tensor, blur: torch.Tensor, slope: torch.Tensor) -> torch.Tensor:
    """Grey elements in [0, 1] from uniform random patterns (N, H, W), which are periodic.

    A pattern is blurred, brought to variance 1, and cut off where ``1/2 + slope * value`` leaves [0, 1]. The part
    `density` of it is above 1/2.
    """
    rows, columns = pattern.shape[1:]
    frequency = torch.fft.fftfreq(rows)[:, None] ** 2 + torch.fft.rfftfreq(columns) ** 2
    gaussian = torch.exp(-2 * (np.pi * blur) ** 2 * frequency.to(pattern.device))
    blurred = torch.fft.irfft2(torch.fft.rfft2(pattern - 0.5) * gaussian, (rows, columns))
    value = blurred / blurred.std((1, 2), keepdim=True)
    return (0.5 + slope * (value + torch.special.ndtri(density))).clamp(0, 1)
