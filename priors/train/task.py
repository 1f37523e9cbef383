"""What is trained: a denoiser, its loss and its validation."""

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

LEAST = 1e-6  # added to squares: errors below 0.001 are as good as none


@dataclass(frozen=True)
class Sample:
    """What a step of one process sees: `batch` crops of so many frames of `crop` x `crop` pixels."""

    frames: int
    batch: int
    crop: int


class Plain:
    """The net sees noisy frames as they are."""

    origin = "random weights"

    def start(self) -> Network:
        """A network to begin with."""
        return Network()

    def __call__(self, noisy: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The frames of `noisy` and their noise level, which is `sigma` (V,) everywhere in a clip."""
        return noisy, np.broadcast_to(sigma[:, None, None, None], noisy.shape).copy()


class Averaged:
    """The net sees averages along the motion that the image net's frames show."""

    origin = "that net"

    def __init__(self) -> None:
        self.image = ImageNet()

    def start(self) -> Network:
        """The image net, to begin with."""
        return _weights.load(WEIGHTS / "ffdnet.safetensors", "ffdnet")[0].train()

    def __call__(self, noisy: np.ndarray, sigma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The averages of `noisy` and the noise level that is left in each pixel."""
        clips = [(clip[None], float(level)) for clip, level in zip(noisy, sigma)]
        parts = [averaged(clip, level, see(self.image, clip, level)) for clip, level in clips]
        mean, level = (np.concatenate(part) for part in zip(*parts))
        return mean, level


SEEN: dict[str, Callable[[], Plain | Averaged]] = {"ffdnet": Plain, "video": Averaged}


class Denoising:
    """The prior `name`, trained to take noise of known level off clips; a task of :mod:`pnp_sci.training.loop`."""

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
        self.learned = 0  # frames of them that the network has been trained on
        self.compiled = [self.network]
        self.sampler = Sampler(training, frames=sample.frames, crop=sample.crop, batch=sample.batch, seed=seed)

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Logarithm of a frame's squared error, in units of its noise; with a watch as many frames of a solver's too.

        The first are gathered here, so that a run that is resumed begins with what its own weights lead to.
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
        """Sums of the PSNR in dB at each of the validation's levels, and the number of clips.

        What this network sees within the solver joins the samples.
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
