"""Training samples from the solver: inputs of the network during solves, with the true frames.

The errors of a solver's estimates differ from white noise. Measurements of training clips are solved with the current
network, and its inputs are stored with the truth. As the inputs depend on the weights, new ones are collected at each
validation and added to the earlier ones (DAgger).

S. Ross, G. Gordon & J. A. Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", AISTATS 2011.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

import pnp_sci
from pnp_sci.plugins.protocols import Prior
from pnp_sci.training.clips import Clip
from priors.ffdnet import FFDNet
from priors.networks import files
from priors.networks.runner import Runner, opened
from priors.train.data import Sampler
from priors.video import Video

PRIORS = {"video": Video, "ffdnet": FFDNet}

SETUPS = {(2, 10): 0.45, (2, 6): 0.13, (2, 14): 0.1, (1, 8): 0.2, (1, 16): 0.12}  # (views, frames): probability
QUIET, NOISE = 0.65, (0.004, 0.1)  # fraction without noise, and range of the others' log-uniform noise, of max(y)
DENSE, DENSITY = 0.75, (0.3, 0.6)  # fraction of masks of density 1/2, and range of the others' uniform density
BEST = 0.3  # fraction of measurements solved with effort="best"
LONG, MANY = 0.15, 150  # fraction of measurements solved with a larger number of iterations, and that number
CALLS, FRAMES = 5, 8  # calls kept per measurement, the last one among them, and frames kept per call, at most


@dataclass(frozen=True)
class States:
    """Inputs of the network, frames and noise level, and the true frames: float16 (N, H, W) each."""

    frames: np.ndarray
    level: np.ndarray
    truth: np.ndarray

    def draw(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Draw `count` samples, three arrays (count, H, W) of float32, randomly rotated and mirrored."""
        chosen = random.integers(len(self.frames), size=count)
        quarters, flip = int(random.integers(4)), random.choice([-1, 1])
        return tuple(  # type: ignore[return-value]
            np.rot90(a[chosen], quarters, (1, 2))[:, ::flip].astype(np.float32)
            for a in (self.frames, self.level, self.truth)
        )


class Watch:
    """Solves measurements of `crop` x `crop` pixels with a prior and stores the inputs of its network.

    Parameters
    ----------
    clips : sequence of Clip
        Source of the views.
    name : "video" or "ffdnet"
        The prior.
    solves : int
        Measurements per call. Each takes about 2 MB with crops of 96 pixels.
    crop : int
        Height and width in pixels.
    seed, rank : int
        Seed of the random measurements.
    """

    def __init__(self, clips: Sequence[Clip], name: str, solves: int, crop: int, seed: int, rank: int):
        self.clips, self.name, self.solves, self.crop = clips, name, solves, crop
        self.random = np.random.default_rng([seed, rank])

    def __call__(self, network: torch.nn.Module) -> States:
        """Solve measurements with the weights of `network`; return its inputs."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.name}.safetensors"
            files.save(path, self.name, network.architecture, network)  # type: ignore[arg-type]
            return self._gathered(opened(path, self.name, None), PRIORS[self.name](weights=path))

    def _gathered(self, runner: Runner, prior: Prior) -> States:
        """The inputs of `runner` during solves with `prior`."""
        seen: list[tuple[np.ndarray, np.ndarray]] = []
        kept: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        with _watched(runner, seen):
            for _ in range(self.solves):
                seen.clear()
                truth = _solved(self.clips, prior, self.crop, self.random)
                last = len(seen) - 1
                for call in sorted({last, *self.random.integers(last + 1, size=CALLS - 1).tolist()}):
                    chosen = self.random.permutation(len(truth))[:FRAMES]
                    frames, level = seen[call]
                    kept.append((frames[chosen], level[chosen], truth[chosen]))
        return States(*(np.concatenate(part) for part in zip(*kept)))


@contextmanager
def _watched(runner: Runner, seen: list[tuple[np.ndarray, np.ndarray]]) -> Iterator[None]:
    """Context in which the inputs of `runner`, frames and levels, are appended to `seen`."""

    def noise(frames: np.ndarray, level: np.ndarray, turn: int) -> np.ndarray:
        if np.isfinite(frames).all():
            seen.append((frames.astype(np.float16), level.astype(np.float16)))
        return type(runner).noise(runner, frames, level, turn)

    runner.noise = noise  # type: ignore[method-assign]
    try:
        yield
    finally:
        del runner.noise


def _solved(clips: Sequence[Clip], prior: Prior, crop: int, random: np.random.Generator) -> np.ndarray:
    """Solve one random measurement; return its truth (V * B, H, W), float16, in the units of the network's input."""
    views, frames = list(SETUPS)[random.choice(len(SETUPS), p=list(SETUPS.values()))]
    sampler = Sampler(clips, frames=frames, crop=crop, batch=1, seed=0)
    truth = np.stack([sampler.piece(random) for _ in range(views)]).astype(np.float32) / 255
    density = 0.5 if random.random() < DENSE else random.uniform(*DENSITY)
    masks = pnp_sci.moving_masks(truth.shape, density, seed=int(random.integers(2**31)))  # type: ignore[arg-type]
    noise = 0.0 if random.random() < QUIET else float(np.exp(random.uniform(*np.log(NOISE))))
    y = pnp_sci.simulate(truth, masks, noise, seed=int(random.integers(2**31)))
    kind = random.random()
    effort, iterations = "best" if kind < BEST else "balanced", MANY if kind > 1 - LONG else None
    result = pnp_sci.solve(y, masks, prior, effort=effort, iterations=iterations, scene="full", tol=0)
    return (truth / result.settings["unit"][0]).reshape(-1, crop, crop).astype(np.float16)
