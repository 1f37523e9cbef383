"""What is trained: a denoiser, its loss and its validation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from pnp_sci.training.clips import Clip
from pnp_sci.training.loop import Place, Progress

from .. import _weights
from .._network import ARCHITECTURES, Network
from .card import write_card
from .data import Sampler
from .validation import LEVELS, psnr


@dataclass(frozen=True)
class Sample:
    """What a step of one process sees: `batch` crops of so many frames of `crop` x `crop` pixels."""

    frames: int
    batch: int
    crop: int = 64


class Denoising:
    """The prior `name`, trained to take noise of known level off clips; a task of :mod:`pnp_sci.training.loop`."""

    scores = tuple(f"psnr_{level}" for level in LEVELS)

    def __init__(
        self, name: str, training: Sequence[Clip], validation: Sequence[Clip], sample: Sample, seed: int, weights: Path,
        command: str,
    ):  # fmt: skip
        torch.manual_seed(seed)
        self.name, self.sample, self.weights, self.command = name, sample, weights, command
        self.training, self.validation = training, validation
        self.network = Network(ARCHITECTURES[name])
        self.compiled = [self.network]
        self.sampler = Sampler(training, frames=sample.frames, crop=sample.crop, batch=sample.batch, seed=seed)

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Absolute error over the square root of sigma, so that no level drowns the others."""
        clean, noisy, sigma = (torch.from_numpy(a).to(place.device) for a in self.sampler(place.rank, step))
        with torch.autocast(place.device.type, torch.bfloat16):
            out = noisy - model(noisy, sigma)
        return ((out - clean).abs().mean((1, 2, 3)) / (sigma + 1 / 255).sqrt()).mean()

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sums of the PSNR in dB at each of the validation's levels, and the number of clips."""
        clips = self.validation[place.rank :: place.world]
        return torch.cat([psnr(network, clips, place.device), torch.tensor([float(len(clips))])])

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write weights and model card."""
        digest = _weights.save(self.weights, self.name, ARCHITECTURES[self.name], network)
        write_card(self, progress, place, digest)
