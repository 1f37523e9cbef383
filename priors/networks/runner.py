"""Inference on arrays and tensors: device, precision, and batches that fit into memory."""

from __future__ import annotations

import math
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pnp_sci.accel.arrays import library
from pnp_sci.accel.inference import ready, running, usable
from priors.networks import files as _weights

CACHED = 2**18  # pixels of a batch on a CPU
PIXELS = 2**24  # pixels of a batch on another device, about 3 GB of activations in bfloat16


def opened(path: Path, name: str, device: str | None) -> Runner:
    """The network of a file of weights; cached until the file changes."""
    changed = path.stat().st_mtime_ns if path.is_file() else None
    return _opened(path, name, device, changed)


@lru_cache(maxsize=8)
def _opened(path: Path, name: str, device: str | None, changed: int | None) -> Runner:
    return Runner(path, name, device)


class Runner:
    """A network on its device, called with arrays of numpy or tensors.

    Parameters
    ----------
    path : Path
        File of weights.
    name : str
        Name of the prior.
    device : str or None
        Torch device; None is the CPU.
    """

    def __init__(self, path: Path, name: str, device: str | None):
        self.device = usable(device)
        network, self.sha256 = _weights.load(path, name)
        self.network = ready(network, self.device)

    def noise(self, frames: Any, level: Any, turn: int = 0) -> Any:
        """Estimate the noise of frames (N, H, W) with standard deviation `level` (N, H, W); all are float32.

        Arrays of numpy, or tensors. The argument `turn` is as for :func:`turned`.
        """
        out = library(frames).empty_like(frames)
        step = max(1, (CACHED if self.device.type == "cpu" else PIXELS) // math.prod(frames.shape[1:]))
        with running(self.device):
            for start in range(0, len(frames), step):
                part = slice(start, start + step)
                x, sigma = (torch.as_tensor(a[part], device=self.device) for a in (frames, level))
                noise = self.network(turned(x, turn), turned(sigma, turn))
                noise = turned(noise, turn, back=True)
                out[part] = noise.numpy(force=True) if isinstance(frames, np.ndarray) else noise
        return out


def turned(frames: torch.Tensor, turn: int, back: bool = False) -> torch.Tensor:
    """Rotate frames (N, H, W) by `turn` quarter turns, modulo 8, after a reflection from 4 on; `back` inverts it."""
    quarters, mirrored = turn % 4, turn % 8 >= 4
    if back:
        frames = frames.rot90(-quarters, (1, 2))
        return frames.flip(2) if mirrored else frames
    return (frames.flip(2) if mirrored else frames).rot90(quarters, (1, 2))
