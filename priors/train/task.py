"""The training task: a denoiser, its loss and its validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from pnp_sci.training.clips import Clip
from pnp_sci.training.loop import Place, Progress
from priors.networks import files as _weights
from priors.networks.along_motion import averaged, see
from priors.networks.image import WEIGHTS, ImageNet
from priors.networks.unet import Network
from priors.train.card import write_card
from priors.train.data import Sampler
from priors.train.states import States, Watch
from priors.train.validation import LEVELS, denoised, psnr

LEAST = 1e-6  # added to mean squares in the loss, which limits the weight of errors below 0.001


@dataclass(frozen=True)
class Sample:
    """Samples of a step and process: `batch` crops of `frames` frames of `crop` x `crop` pixels."""

    frames: int
    batch: int
    crop: int


class Plain:
    """The network's input is the noisy frames."""

    origin = "random weights"

    def start(self) -> Network:
        """A network with random weights."""
        return Network()

    def __call__(self, noisy: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The frames `noisy` (V, B, H, W) and their noise level, `sigma` (V,) in all pixels of a clip."""
        return noisy, np.broadcast_to(sigma[:, None, None, None], noisy.shape).copy()


class Averaged:
    """The network's input is averages along the motion, which is estimated after the image net."""

    origin = "the weights of the image net"

    def __init__(self) -> None:
        self.image = ImageNet()

    def start(self) -> Network:
        """A network with the weights of the image net."""
        return _weights.load(WEIGHTS / "ffdnet.safetensors", "ffdnet")[0].train()

    def __call__(self, noisy: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Averages of `noisy` (V, B, H, W) along the motion, and the standard deviation of their noise."""
        clips = [(clip[None], float(level)) for clip, level in zip(noisy, sigma)]
        parts = [averaged(clip, level, see(self.image, clip, level)) for clip, level in clips]
        mean, level = (np.concatenate(part) for part in zip(*parts))
        return mean, level


SEEN: dict[str, Callable[[], Plain | Averaged]] = {"ffdnet": Plain, "video": Averaged}


class Denoising:
    """Training of the network of the prior `name`, a task of :mod:`pnp_sci.training.loop`."""

    scores = tuple(f"psnr_{level}" for level in LEVELS)

    def __init__(
        self, name: str, training: Sequence[Clip], validation: Sequence[Clip], sample: Sample, seed: int, weights: Path,
        command: str, start: Path | None = None, watch: Watch | None = None,
    ):  # fmt: skip
        torch.manual_seed(seed)
        self.name, self.sample, self.weights, self.command = name, sample, weights, command
        self.training, self.validation, self.watch = training, validation, watch
        self.prepare = SEEN[name]()
        self.network = _weights.load(start, name)[0].train() if start else self.prepare.start()
        self.settings = str(self.network.architecture)
        self.origin = "earlier weights" if start else self.prepare.origin
        self.collections: list[States] = []
        self.learned = 0  # number of frames of the collections used for training
        self.compiled = [self.network]
        self.sampler = Sampler(training, frames=sample.frames, crop=sample.crop, batch=sample.batch, seed=seed)

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Mean logarithm of the squared error of a frame, relative to its noise.

        With a watch, half of the frames are inputs during solves. The first collection is made here, so that a resumed
        run uses its own weights.
        """
        clean, noisy, sigma = self.sampler(place.rank, step)
        samples = [(*self.prepare(noisy, sigma), clean)]
        if self.watch:
            self.collections = self.collections or [self.watch(self.network)]
            random = np.random.default_rng([self.sampler.seed, place.rank, step, 1])
            collection = self.collections[random.integers(len(self.collections))]
            frames, level, truth = collection.draw(random, clean.shape[0] * clean.shape[1])
            samples.append((frames[None], level[None], truth[None]))
        losses = []
        for frames, level, truth in samples:
            error = denoised(model, frames, level, place.device) - torch.from_numpy(truth).to(place.device)
            noise = torch.from_numpy(level).to(place.device)
            left, before = (a.square().mean((2, 3)) + LEAST for a in (error, noise))
            losses.append((left / before).log().mean())
        return torch.stack(losses).mean()

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sums of the PSNR in dB at each validation level, and the number of clips.

        With a watch, it also collects new samples.
        """
        if self.watch:
            self.learned = sum(len(collection.frames) for collection in self.collections)
            self.collections.append(self.watch(network))
        clips = self.validation[place.rank :: place.world]
        return torch.cat([psnr(network, self.prepare, clips, place.device), torch.tensor([float(len(clips))])])

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write weights and model card."""
        digest = _weights.save(self.weights, self.name, self.network.architecture, network)
        write_card(self, progress, place, digest)
