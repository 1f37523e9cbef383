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
from priors.kernels.shuffle import shuffle, unshuffle
from priors.networks import LIMIT
from priors.networks import files as _weights
from priors.networks.unet import continued

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
        host = isinstance(frames, np.ndarray) or frames.device.type == "cpu"
        of_part = self._on_cpu if host and self.device.type == "cpu" else self._on_device
        step = max(1, (CACHED if self.device.type == "cpu" else PIXELS) // math.prod(frames.shape[1:]))
        with running(self.device):
            for start in range(0, len(frames), step):
                part = slice(start, start + step)
                of_part(frames[part], level[part], turn, out[part])
        return out

    def _on_cpu(self, frames: Any, level: Any, turn: int, out: Any) -> None:
        """out <- the noise of some frames; turned views are read and written in place."""
        x, sigma, noise = (turned(np.asarray(a), turn) for a in (frames, level, out))
        rows, columns = (continued(n, self.network.architecture.multiple).numpy() for n in x.shape[1:])
        seen = np.empty((len(x), len(rows) // 2, len(columns) // 2, 5), np.float32)
        unshuffle(x, sigma, rows, columns, seen)
        of_blocks = self.network.of_blocks(torch.from_numpy(seen).permute(0, 3, 1, 2))
        shuffle(of_blocks.permute(0, 2, 3, 1).numpy(), sigma, np.float32(LIMIT), noise)

    def _on_device(self, frames: Any, level: Any, turn: int, out: Any) -> None:
        """out <- the noise of some frames, by operations of torch."""
        x, sigma = (turned(torch.as_tensor(a, device=self.device), turn) for a in (frames, level))
        noise = turned(self.network(x, sigma), turn, back=True)
        out[:] = noise.numpy(force=True) if isinstance(out, np.ndarray) else noise


def turned(frames: Any, turn: int, back: bool = False) -> Any:
    """Rotate frames (N, H, W) by `turn` quarter turns, modulo 8, after a reflection from 4 on; `back` inverts it.

    Of an array of numpy it is a view.
    """
    np_or_torch, quarters, mirrored = library(frames), turn % 4, turn % 8 >= 4
    if back:
        frames = np_or_torch.rot90(frames, -quarters, (1, 2))
        return np_or_torch.flip(frames, (2,)) if mirrored else frames
    return np_or_torch.rot90(np_or_torch.flip(frames, (2,)) if mirrored else frames, quarters, (1, 2))
