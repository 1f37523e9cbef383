"""PSNR on the clips held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch

from pnp_sci.training.clips import Clip

LEVELS = (5, 15, 25, 40)  # of 255
FRAMES, SIZE = 10, 256  # first frames and central square of every clip


def psnr(network: torch.nn.Module, clips: Sequence[Clip], device: torch.device) -> torch.Tensor:
    """Sum over `clips` of each level's PSNR in dB (mean of the frames' PSNR, peak 1), on the noise of a fixed seed."""
    total = torch.zeros(len(LEVELS), dtype=torch.float64)
    with torch.inference_mode(), torch.autocast(device.type, torch.bfloat16):
        for clip in clips:
            top, left = (max(size - SIZE, 0) // 2 for size in clip.frames.shape[1:])
            frames = clip.frames[:FRAMES, top : top + SIZE, left : left + SIZE]
            clean = torch.from_numpy(frames.astype(np.float32) / 255)[None].to(device)
            white = np.random.default_rng(0).standard_normal(clean.shape, np.float32)
            for i, level in enumerate(LEVELS):
                noisy = clean + torch.from_numpy(white).to(device) * (level / 255)
                out = (noisy - network(noisy, torch.tensor([level / 255], device=device))).clamp(0, 1)
                error = (out.double() - clean.double()).square().mean((0, 2, 3)).clamp(min=1e-12)
                total[i] -= 10 * error.log10().mean().cpu()
    return total
