"""Total variation on tensors; :mod:`priors.tv` says what it does."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch

from pnp_sci.plugins.protocols import Session
from priors.kernels.dual import ALL, NOTHING, STEP
from priors.kernels.still import TUNED as STILL
from priors.kernels.still import sureness
from priors.on_device.filters import box, gaussian, tie

AXES = (-2, -1, -3)  # rows, columns, time


class TVOnDevice(Session):
    """Total variation of one video (V, B, H, W): the dual variable (2 or 3, V, B, H, W), weights along time, rest.

    The dual variable has the dtype of the video; that of :class:`priors.tv.TVSession` has multiples of 1/32767.

    Parameters
    ----------
    prior : TV
    numbers : TVNumbers
    shape, dtype, device
        As for :meth:`priors.tv.TV.begin_on`.
    """

    def __init__(self, prior: Any, numbers: Any, shape: tuple[int, ...], dtype: np.dtype, device: str):
        self.prior, self.numbers, self.calls = prior, numbers, 0
        along_time = shape[1] > 1 and prior.time != 0
        kind = getattr(torch, np.dtype(dtype).name)
        self.dual = torch.zeros((2 + along_time, *shape), dtype=kind, device=device)
        constant = self.numbers.time_before if prior.time == "auto" else prior.time
        self.largest = float(constant if along_time else 0)
        self.weights: torch.Tensor | float = self.largest  # along time, one number or (V, 1, H, W)
        self.still: torch.Tensor | None = None  # how surely a pixel shows the same in all frames, (V, 1, H, W)

    def __call__(self, v: torch.Tensor, sigma: float, out: torch.Tensor | None = None) -> torch.Tensor:
        """Denoise v (V, B, H, W)."""
        weight = min(self.prior.strength * sigma, ALL)
        if weight < NOTHING:
            return v
        step = STEP / (8 * (1 + self.largest**2 / 2) * weight)
        for _ in range(int(self.prior.inner)):
            self._ascend(v + weight * self._divergence(), step)
        x = torch.add(v, self._divergence(), alpha=weight, out=out)
        self.calls += 1
        if self.prior.time == "auto" and v.shape[1] > 1:
            self._look(x, sigma, weight)
            if self.still is not None:
                x.copy_(tie(x, self.still, x))
        return x

    def facts(self) -> Mapping[str, Any]:
        """The part of each view that stands still, as last measured."""
        return {"still": [] if self.still is None else self.still.mean((1, 2, 3)).tolist()}

    def _divergence(self) -> torch.Tensor:
        """div p (V, B, H, W), weighted along time."""
        total = torch.zeros_like(self.dual[0])
        for axis, p in zip(AXES, self.dual):
            p = p * self.weights if axis == -3 else p
            total += p
            _from(total, axis).sub_(_until(p, axis))
        return total

    def _ascend(self, u: torch.Tensor, step: float) -> None:
        """p <- projection of p + step * gradient of u (V, B, H, W)."""
        for axis, p in zip(AXES, self.dual):
            change = u.diff(dim=axis)
            _until(p, axis).add_(change * self.weights if axis == -3 else change, alpha=step)
        if self.prior.isotropic:
            self.dual /= torch.linalg.vector_norm(self.dual, dim=0).clamp(min=1)
        else:
            self.dual.clamp_(-1, 1)

    def _look(self, x: torch.Tensor, sigma: float, weight: float) -> None:
        """What the estimate x shows of motion, see :class:`priors.tv.TVSession`."""
        if self.calls == self.numbers.settle and sigma <= self.numbers.trusted:
            self.weights, self.largest = time_weights(x, self.numbers), self.numbers.time_most
        if self.prior.still and self.calls % self.numbers.settle == 0:
            rest = float(min(self.numbers.rest * x.shape[0] * x.shape[1] * weight, STILL.rest))
            self.still = at_rest(x, rest)


def _until(x: torch.Tensor, axis: int) -> torch.Tensor:
    """All but the last along an axis."""
    return x.narrow(axis, 0, x.shape[axis] - 1)


def _from(x: torch.Tensor, axis: int) -> torch.Tensor:
    """All but the first along an axis."""
    return x.narrow(axis, 1, x.shape[axis] - 1)


def time_weights(x: torch.Tensor, numbers: Any) -> torch.Tensor:
    """Weight along time for each pixel (V, 1, H, W) of x (V, B, H, W), as :func:`priors.tv.time_weights`."""
    square = torch.zeros_like(x)
    for axis in (-2, -1):
        _until(square, axis).add_(x.diff(dim=axis).square())
    space, change = square.sqrt().mean(1, keepdim=True), x.diff(dim=1).abs().mean(1, keepdim=True)
    space, change = (box(a, numbers.around, times=2) for a in (space, change))
    ratio = (space + 1e-4) / (change + 1e-4)
    return (numbers.time * ratio**numbers.power).clamp(0, numbers.time_most)


def at_rest(x: torch.Tensor, rest: float) -> torch.Tensor:
    """Probability that each pixel of x (V, B, H, W) is constant in time, (V, 1, H, W), as :func:`priors.tv.at_rest`."""
    brightness, variance = x.mean(1, keepdim=True), x.var(1, correction=0, keepdim=True)
    return sureness(gaussian(variance, 1.5), gaussian(brightness, 1.5), rest)
