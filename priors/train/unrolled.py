"""Repeats calls of the solver so that gradients reach the weights of the network.

The loss of a call also depends on the calls before it, through the projection, the multiplier and the averages along
the motion. So the network learns what reduces the error after several calls, not what removes most noise in one.
Displacement and total variation are computed as in the solver, and the motion is that of the solver. For the gradient
the motion is constant; displacement and total variation count as the identity.

K. Gregor & Y. LeCun, "Learning fast approximations of sparse coding", ICML 2010: training through the iterations.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np
import torch

from pnp_sci.accel.inference import mixed_precision
from pnp_sci.plugins.protocols import Session
from pnp_sci.sensing.torch_operator import TorchSensingOperator
from pnp_sci.solvers.displacement import FAINT, displace
from pnp_sci.solvers.gap import gap_step
from pnp_sci.solvers.iterate import rescaled
from pnp_sci.solvers.state import State
from priors.motion.videos import OfArrays
from priors.networks import along_motion
from priors.networks.runner import turned
from priors.session import NetworkSession
from priors.train.windows import Window


def estimates(window: Window, network: torch.nn.Module, device: torch.device) -> Iterator[torch.Tensor]:
    """The estimates x (V, B, H, W) after each call of a window, with `network`."""
    first = window.first
    motion = WithGradient(first.motion, device) if first.motion else None
    net: Any = Trained(network, motion)
    session = NetworkSession(net, Passing(first.beside), first.stronger, first.turn)
    op, s = TorchSensingOperator(first.op, device=device), first.state
    y, x, residual, dual = (torch.from_numpy(a).to(device) for a in (first.y, s.x, s.residual, s.dual))
    state = State(s.iteration, x, residual, dual, s.sigma, s.pace)
    for sigma, rho in window.steps:
        noise = sigma + float(np.mean(rho)) / float(op.gram.mean())
        denoise = partial(_denoised, session, state.x if motion else None, noise)
        trust = torch.from_numpy(rho).to(device) if isinstance(rho, np.ndarray) else rho
        state = gap_step(op, y, denoise, rescaled(state, sigma), sigma, trust)
        yield state.x


def _denoised(session: Session, x: torch.Tensor | None, noise: float, v: Any, sigma: float) -> Any:
    """Displace v, where there is motion, as it differs from the estimate x; then denoise it."""
    if x is not None and sigma >= FAINT:
        estimate = x.numpy(force=True)
        v = passed(v, lambda array: displace(estimate, array, noise))
    return session(v, sigma)


def passed(v: torch.Tensor, change: Callable[[np.ndarray], np.ndarray | None]) -> torch.Tensor:
    """Apply `change` to v on the CPU; its gradient is taken as the identity."""
    given, array = v.numpy(force=True), v.numpy(force=True).copy()
    changed = change(array)
    return v + torch.from_numpy((array if changed is None else changed) - given).to(v.device)


class Passing(Session):
    """A session for arrays, such as that of total variation; gradients pass as if it did nothing."""

    def __init__(self, session: Any):
        self.session = deepcopy(session)

    def __call__(self, v: Any, sigma: float, out: Any = None) -> Any:
        """Denoise v (V, B, H, W)."""
        return passed(v, lambda array: self.session(array, sigma))


class Trained:
    """A network in the place of :class:`VideoNet`, with a given motion, or of :class:`ImageNet`, without."""

    def __init__(self, network: torch.nn.Module, motion: WithGradient | None):
        self.network, self.motion = network, motion

    def __call__(self, x: torch.Tensor, sigma: float, turn: int) -> torch.Tensor:
        """Denoise x (V, B, H, W)."""
        if self.motion is None:
            frames = x.flatten(0, 1)
            return x - self._noise(frames, torch.full_like(frames, sigma), turn).reshape(x.shape)
        return x - along_motion.noise(x, sigma, self.motion, partial(self._noise, turn=turn))

    def _noise(self, frames: torch.Tensor, level: torch.Tensor, turn: int) -> torch.Tensor:
        with mixed_precision(level.device):
            noise = self.network(turned(frames, turn), turned(level, turn))
        return turned(noise, turn, back=True)


class WithGradient:
    """The motion of arrays for tensors (V, B, H, W), whose averages have a gradient."""

    def __init__(self, motion: OfArrays, device: torch.device):
        self.motion, self.remaining = motion, torch.from_numpy(motion.remaining).to(device)

    @property
    def at_rest(self) -> list[float]:
        """Fraction of the pixels of each view that are still, 0 to 1."""
        return self.motion.at_rest

    def average(self, x: torch.Tensor) -> torch.Tensor:
        """Each frame of x (V, B, H, W) averaged with its neighbours along the motion."""
        return _Average.apply(x, self.motion)  # type: ignore[no-any-return]


class _Average(torch.autograd.Function):
    """The averages along the motion; they are linear, so the gradient is that of the transposed averages."""

    @staticmethod
    def forward(ctx: Any, x: torch.Tensor, motion: OfArrays) -> torch.Tensor:
        """Average x (V, B, H, W)."""
        ctx.motion = motion
        return torch.from_numpy(motion.average(np.ascontiguousarray(x.numpy(force=True)))).to(x.device)

    @staticmethod
    def backward(ctx: Any, grad: torch.Tensor) -> tuple[torch.Tensor, None]:
        """The gradient of x from that of its average."""
        g = np.ascontiguousarray(grad.numpy(force=True))
        out = np.empty_like(g)
        for view, motion, own in zip(g, ctx.motion.views, out):
            motion.spread(view, own)
        return torch.from_numpy(out).to(grad.device), None
