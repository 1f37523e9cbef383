"""PSNR on the held-out clips."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch

from pnp_sci.accel.inference import mixed_precision
from pnp_sci.training.clips import Clip

Prepare = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]

LEVELS = (5, 15, 25, 40)  # standard deviations of the noise, in units of 1/255
FRAMES, SIZE = 10, 256  # first frames, and pixels per side of the central square of each clip


def denoised(network: torch.nn.Module, frames: np.ndarray, level: np.ndarray, device: torch.device) -> torch.Tensor:
    """`frames` (V, B, H, W) minus the noise that the network estimates for its `level` (V, B, H, W)."""
    x, sigma = (torch.from_numpy(a).to(device).flatten(0, 1) for a in (frames, level))
    with mixed_precision(device):
        return (x - network(x, sigma)).unflatten(0, frames.shape[:2])


def psnr(network: torch.nn.Module, prepare: Prepare, clips: Sequence[Clip], device: torch.device) -> torch.Tensor:
    """Sum over `clips` of the PSNR in dB at each level (mean over frames, peak 1), for noise of a fixed seed.

    `prepare` turns noisy clips and their levels into the network's input and the level of its noise.
    """
    total = torch.zeros(len(LEVELS), dtype=torch.float64)
    for clip in clips:
        top, left = (max(size - SIZE, 0) // 2 for size in clip.frames.shape[1:])
        clean = clip.frames[None, :FRAMES, top : top + SIZE, left : left + SIZE].astype(np.float32) / 255
        white = np.random.default_rng(0).standard_normal(clean.shape, np.float32)
        for i, level in enumerate(LEVELS):
            seen = prepare(clean + white * np.float32(level / 255), np.array([level / 255], np.float32))
            with torch.inference_mode():
                out = denoised(network, *seen, device).clamp(0, 1).cpu().double()
            error = (out - torch.from_numpy(clean)).square().mean((0, 2, 3)).clamp(min=1e-12)
            total[i] -= 10 * error.log10().mean()
    return total
