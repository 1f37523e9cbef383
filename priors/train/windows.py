"""Training samples from the solver: some of its calls in a row, with the true frames.

The errors of a solver's estimates differ from white noise. Measurements of training clips are solved with the current
network, and calls are kept from which :mod:`priors.train.unrolled` runs the solver again. As the estimates depend on
the weights, new calls are collected after each validation; the last three collections are used (DAgger).

S. Ross, G. Gordon & J. A. Bagnell, "A reduction of imitation learning and structured prediction to no-regret online
learning", AISTATS 2011.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import torch

from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Prior
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.gap import gap_step
from pnp_sci.solvers.iterate import ALGORITHMS
from pnp_sci.solvers.state import State
from pnp_sci.training.clips import Clip
from priors.ffdnet import FFDNet
from priors.motion.videos import OfArrays
from priors.networks import files
from priors.session import NetworkSession
from priors.train.solves import solved
from priors.video import Video

PRIORS = {"video": Video, "ffdnet": FFDNet}

CALLS = Video.renew  # of a window: `video` keeps a motion for as many
WINDOWS = 4  # kept per measurement, the last one among them, at most


@dataclass(frozen=True, eq=False)
class Call:
    """A call of a network within the solver.

    Attributes
    ----------
    op : SensingOperator
    y : ndarray, (H, W)
    state : State
        Before the iteration.
    sigma : float
    rho : float or ndarray, (H, W)
        Of the iteration.
    beside : Session
        Of total variation, before the call.
    stronger, turn
        As :class:`priors.session.NetworkSession` has them before the call.
    motion : OfArrays, or None for the image net
    """

    op: SensingOperator
    y: np.ndarray
    state: State
    sigma: float
    rho: Any
    beside: Any
    stronger: float
    turn: int
    motion: OfArrays | None


@dataclass(frozen=True, eq=False)
class Window:
    """Calls in a row with the same motion.

    Attributes
    ----------
    first : Call
    steps : tuple of (float, float or ndarray)
        sigma and rho of each call, the first one included.
    truth : ndarray, (V, B, H, W)
        The true frames in the units of the estimates.
    """

    first: Call
    steps: tuple[tuple[float, Any], ...]
    truth: np.ndarray


class Watch:
    """Solves measurements of `crop` x `crop` pixels with a prior and keeps calls of its network.

    Parameters
    ----------
    clips : sequence of Clip
        Source of the views.
    name : "video" or "ffdnet"
        The prior.
    solves : int
        Measurements per collection. Each takes about 15 MB with crops of 96 pixels, in each of three collections.
    crop : int
        Height and width in pixels.
    seed, rank : int
        Seed of the random measurements.
    """

    def __init__(self, clips: Sequence[Clip], name: str, solves: int, crop: int, seed: int, rank: int):
        self.clips, self.name, self.solves, self.crop, self.seed, self.rank = clips, name, solves, crop, seed, rank

    def __call__(self, network: torch.nn.Module, collection: int) -> list[Window]:
        """Solve the measurements of a collection with the weights of `network`; return windows of its calls."""
        random = np.random.default_rng([self.seed, self.rank, collection, 2])
        with TemporaryDirectory() as folder:
            path = Path(folder) / f"{self.name}.safetensors"
            files.save(path, self.name, network.architecture, network)  # type: ignore[arg-type]
            prior = PRIORS[self.name](weights=path)
            found = [window for _ in range(self.solves) for window in self._of_one(prior, random)]
        if not found:
            raise InputError(f"solves: none of {self.solves} measurements gave {CALLS} calls of the network in a row")
        return found

    def _of_one(self, prior: Prior, random: np.random.Generator) -> list[Window]:
        """Windows of the solve of one random measurement."""
        with _watched() as calls:
            truth = solved(self.clips, prior, self.crop, random)
        parts = [calls[k : k + CALLS] for k in range(len(calls) - CALLS + 1)]
        parts = [part for part in parts if all(map(_follow, part, part[1:]))]
        chosen = {*random.permutation(len(parts))[: WINDOWS - 1].tolist(), len(parts) - 1}
        return [_window(parts[k], truth) for k in sorted(chosen) if parts]


def _follow(call: Call, following: Call) -> bool:
    """Whether a call follows another one in the next iteration, with the same motion."""
    return call.motion is following.motion and following.state.iteration == call.state.iteration + 1


def _window(calls: list[Call], truth: np.ndarray) -> Window:
    """The calls without what a repetition of them computes."""
    return Window(calls[0], tuple((call.sigma, call.rho) for call in calls), truth)


@contextmanager
def _watched() -> Iterator[list[Call]]:
    """Context in which the calls of networks within GAP are appended to a list."""
    calls: list[Call] = []
    iteration: dict[str, Any] = {}
    serve = NetworkSession.__call__

    def step(op, y, denoise, state, sigma, rho=0.0, saturated=None):
        iteration.update(op=op, y=y, state=state, sigma=sigma, rho=rho)
        return gap_step(op, y, denoise, state, sigma, rho, saturated)

    def watched(session, v, sigma, out=None):
        before = iteration | {"beside": deepcopy(session.beside), "stronger": session.stronger, "turn": session.turn}
        x = serve(session, v, sigma, out)
        calls.append(Call(**before, motion=getattr(session.net, "motion", None)))
        return x

    ALGORITHMS["gap"], NetworkSession.__call__ = step, watched  # type: ignore[method-assign]
    try:
        yield calls
    finally:
        ALGORITHMS["gap"], NetworkSession.__call__ = gap_step, serve  # type: ignore[method-assign]
