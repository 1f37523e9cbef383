"""Running a network on numpy arrays: precision, device, and pieces that fit into memory."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np
import torch

from pnp_sci.accel.inference import ready, running, usable
from priors.networks import files as _weights

# Pixels that a CPU takes together: 20 frames of 256 x 256 take a tenth less time by fours than by eights or at once
CACHED = 2**18
PIXELS = 2**24  # ... and another device: about 3 GB of activations in bfloat16


def opened(path: Path, name: str, device: str | None) -> Runner:
    """The network of a file of weights; read once, and again when the file has changed."""
    changed = path.stat().st_mtime_ns if path.is_file() else None
    return _opened(path, name, device, changed)


@lru_cache(maxsize=8)
def _opened(path: Path, name: str, device: str | None, changed: int | None) -> Runner:
    return Runner(path, name, device)


class Runner:
    """A network on its device, called with numpy arrays."""

    def __init__(self, path: Path, name: str, device: str | None):
        self.device = usable(device)
        network, self.sha256 = _weights.load(path, name)
        self.network = ready(network, self.device)

    def noise(self, frames: np.ndarray, level: np.ndarray, turn: int = 0) -> np.ndarray:
        """Estimate the noise in frames (N, H, W) of this `level` (N, H, W), all float32; `turn` as for `turned`."""
        out = np.empty_like(frames)
        step = max(1, (CACHED if self.device.type == "cpu" else PIXELS) // frames[0].size)
        with running(self.device):
            for start in range(0, len(frames), step):
                part = slice(start, start + step)
                x, sigma = (torch.from_numpy(a[part]).to(self.device) for a in (frames, level))
                noise = self.network(turned(x, turn), turned(sigma, turn))
                out[part] = turned(noise, turn, back=True).cpu().numpy()
        return out


def turned(frames: torch.Tensor, turn: int, back: bool = False) -> torch.Tensor:
    """Frames (N, H, W) after `turn` quarter turns, mirrored before them from the fifth on; or `back` from there."""
    quarters, mirrored = turn % 4, turn % 8 >= 4
    if back:
        frames = frames.rot90(-quarters, (1, 2))
        return frames.flip(2) if mirrored else frames
    return (frames.flip(2) if mirrored else frames).rot90(quarters, (1, 2))
