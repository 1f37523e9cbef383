"""What a network sees within a solver, and what it should make of it.

The estimates that a solver hands to its prior hold other errors than noise. A network that has been trained on noise
goes on from what it meets there: measurements of training clips are solved with it, and what it is shown is kept beside
the truth. Trained on that, it leads the solver elsewhere, so that more is gathered with the new weights, time and again
(Ross, Gordon & Bagnell, "A reduction of imitation learning and structured prediction to no-regret online learning",
2011): trained on one collection only, the network draws things on and on where noise hides the scene.
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

# Views and frames of the measurements that are solved, and how often.
SETUPS = {(2, 10): 0.45, (2, 6): 0.13, (2, 14): 0.1, (1, 8): 0.2, (1, 16): 0.12}
QUIET, NOISE = 0.65, (0.004, 0.1)  # part of them without noise; else log-uniform between these, in parts of max(y)
DENSE, DENSITY = 0.75, (0.3, 0.6)  # part of the masks of density 1/2; else uniform between these
# Part of them that is solved with the iterations of effort="best", and with so many: what a network that goes astray
# makes of a scene in the long run is to be seen too.
BEST, LONG, MANY = 0.3, 0.15, 150
CALLS, FRAMES = 5, 8  # kept of a measurement: the last call and others by chance, and so many frames of each at most


@dataclass(frozen=True)
class States:
    """Frames as the network saw them, the noise level that it was told, and the truth: float16 (N, H, W) each."""

    frames: np.ndarray
    level: np.ndarray
    truth: np.ndarray

    def draw(self, random: np.random.Generator, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """So many of them, (count, H, W) each, float32, turned and flipped."""
        chosen = random.integers(len(self.frames), size=count)
        quarters, flip = int(random.integers(4)), random.choice([-1, 1])
        return tuple(  # type: ignore[return-value]
            np.rot90(a[chosen], quarters, (1, 2))[:, ::flip].astype(np.float32)
            for a in (self.frames, self.level, self.truth)
        )


class Watch:
    """Solves measurements of `crop` x `crop` pixels with a prior, and keeps what its network sees.

    Parameters
    ----------
    clips : sequence of Clip
        Each view shows a piece of one.
    name : "video" or "ffdnet"
        The prior.
    solves : int
        Measurements at a time; what is kept of each takes about 2 MB with crops of 96 pixels.
    crop, seed, rank : int
        The same always draw the same measurements.
    """

    def __init__(self, clips: Sequence[Clip], name: str, solves: int, crop: int, seed: int, rank: int):
        self.clips, self.name, self.solves, self.crop = clips, name, solves, crop
        self.random = np.random.default_rng([seed, rank])

    def __call__(self, network: torch.nn.Module) -> States:
        """What the network, a bare one, sees within the solver."""
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.name}.safetensors"
            files.save(path, self.name, network.architecture, network)  # type: ignore[arg-type]
            return self._gathered(opened(path, self.name, None), PRIORS[self.name](weights=path))

    def _gathered(self, runner: Runner, prior: Prior) -> States:
        """What the runner of this prior is given in some measurements."""
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
    """Meanwhile, `seen` holds the frames and levels that the runner has been given."""

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
    """Solve one measurement; returns its truth (V * B, H, W) in the units that the network saw."""
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
