"""The training task: a denoiser, its loss and its validation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from pnp_sci.errors import FormatError
from pnp_sci.training.clips import Clip
from pnp_sci.training.task import Place, Progress
from priors.networks import files as _weights
from priors.networks.along_motion import averaged, see
from priors.networks.image import WEIGHTS, ImageNet
from priors.networks.unet import Network
from priors.train.card import write_card
from priors.train.data import Sampler
from priors.train.unrolled import estimates
from priors.train.validation import LEVELS, denoised, psnr
from priors.train.windows import Watch, Window

LEAST = 1e-6  # added to mean squares in the loss, which limits the weight of errors below 0.001
KEPT = 3  # number of latest collections that are kept


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
    """Training of the network of the prior `name`, a task of :mod:`pnp_sci.training.task`."""

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
        self.solvers: dict[int, torch.nn.Module] = {0: deepcopy(self.network)}  # for each collection
        self.collections: dict[int, list[Window]] = {}
        self.windows: dict[int, int] = {}  # number of windows in each collection so far
        self.compiled = [self.network]
        self.sampler = Sampler(training, frames=sample.frames, crop=sample.crop, batch=sample.batch, seed=seed)

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Mean logarithm of the squared error of a frame; with a watch, half of it is that of estimates in solves."""
        of_noise = self._of_noise(model, place, step)
        return (of_noise + self._of_solves(model, place, step)) / 2 if self.watch else of_noise

    def _of_noise(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """The loss of noisy frames, relative to their noise."""
        clean, noisy, sigma = self.sampler(place.rank, step)
        frames, level = self.prepare(noisy, sigma)
        error = denoised(model, frames, level, place.device) - torch.from_numpy(clean).to(place.device)
        noise = torch.from_numpy(level).to(place.device)
        left, before = (a.square().mean((2, 3)) + LEAST for a in (error, noise))
        return (left / before).log().mean()

    def _of_solves(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """The loss of estimates in solves; that after the n-th call of a window has weight n.

        Later collections are drawn more often.
        """
        self._collect()
        random = np.random.default_rng([self.sampler.seed, place.rank, step, 1])
        windows = list(self.collections.values())[random.integers(len(self.collections), size=2).max()]
        window = windows[random.integers(len(windows))]
        truth = torch.from_numpy(window.truth).to(place.device)
        made = list(estimates(window, model, place.device))
        losses = [n * ((x - truth).square().mean((2, 3)) + LEAST).log().mean() for n, x in enumerate(made, 1)]
        return torch.stack(losses).sum() / sum(range(len(made) + 1))

    def _collect(self) -> None:
        """Make the collections that are missing, in the place of older ones."""
        assert self.watch
        self.collections = {n: found for n, found in self.collections.items() if n in self.solvers}
        for n in sorted(self.solvers.keys() - self.collections.keys()):
            self.collections[n] = self.watch(self.solvers[n], n)
            self.windows[n] = len(self.collections[n])

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sums of the PSNR in dB at each validation level, and the number of clips.

        With a watch, new samples are collected before the next step.
        """
        if self.watch:
            following = max(self.solvers) + 1
            self.solvers = {n: solver for n, solver in self.solvers.items() if n > following - KEPT}
            self.solvers[following] = deepcopy(network)
        clips = self.validation[place.rank :: place.world]
        return torch.cat([psnr(network, self.prepare, clips, place.device), torch.tensor([float(len(clips))])])

    def state(self) -> dict[str, Any]:
        """What collections are made again from."""
        if not self.watch:
            return {}
        solvers = {n: solver.state_dict() for n, solver in self.solvers.items()}
        return {"solves": self.watch.solves, "solvers": solvers, "windows": self.windows}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from such a state: the last collections are made again before the next step."""
        held, asked = state.get("solves", 0), self.watch.solves if self.watch else 0
        if held != asked:
            raise FormatError(f"resume: the checkpoint is of a run with {held} --solves, but {asked} were asked for")
        if not self.watch:
            return
        self.windows, self.solvers = state["windows"], {}
        for n, weights in state["solvers"].items():
            self.solvers[n] = deepcopy(self.network)
            self.solvers[n].load_state_dict(weights)

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write weights and model card."""
        digest = _weights.save(self.weights, self.name, self.network.architecture, network)
        write_card(self, progress, place, digest)
