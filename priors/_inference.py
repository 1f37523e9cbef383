"""Running a network on numpy arrays: precision, device, and pieces that fit into memory."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from pnp_sci.inference import half_precision, usable

from . import _weights

PIXELS = 2**24  # of one pass, margins included: about 3 GB of activations in bfloat16
CACHED = 2**19  # of the views or single frames that a CPU takes together: 20 frames of 256 x 256 take a quarter less
# time by eights than at once
MARGIN = 4  # frames either side of a piece: the two of the first layer's window, and two for the blocks' exchange


def pieces(frames: int, most: int) -> Iterator[tuple[slice, slice]]:
    """Cut a clip into runs of at most `most` frames, margins included: what a pass sees, and what it is kept for.

    >>> [(seen.start, seen.stop, kept.start, kept.stop) for seen, kept in pieces(30, 20)]
    [(0, 16, 0, 12), (8, 28, 12, 24), (20, 30, 24, 30)]
    """
    step = frames if frames <= most else max(most - 2 * MARGIN, 1)
    for start in range(0, frames, step):
        stop = min(start + step, frames)
        yield slice(max(start - MARGIN, 0), min(stop + MARGIN, frames)), slice(start, stop)


class Runner:
    """A network on its device, called with numpy arrays."""

    def __init__(self, path: Path, name: str, device: str | None):
        self.device = usable(device)
        network, self.sha256 = _weights.load(path, name)
        self.network = network.to(self.device)
        self.half = half_precision(self.device)

    def noise(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Estimate the noise in x (V, B, H, W) float32; returns float32 of the same shape."""
        shape = x.shape
        if self.network.architecture.alone:
            x = x.reshape(-1, 1, *shape[2:])
        views, frames, height, width = x.shape
        out = np.empty(x.shape, np.float32)
        most = CACHED if self.device.type == "cpu" else PIXELS
        together = max(1, min(views, most // (frames * height * width)))
        with torch.inference_mode(), torch.autocast(self.device.type, torch.bfloat16, enabled=self.half):
            for first in range(0, views, together):
                group = slice(first, first + together)
                for seen, kept in pieces(frames, PIXELS // (height * width)):
                    part = torch.from_numpy(x[group, seen]).to(self.device)
                    noise = self.network(part, torch.full((len(part),), sigma, device=self.device))
                    out[group, kept] = noise[:, kept.start - seen.start :][:, : kept.stop - kept.start].cpu().numpy()
        return out.reshape(shape)
