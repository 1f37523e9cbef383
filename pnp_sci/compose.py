"""Priors made of priors: stages one after the other, several at once, and modules of torch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from .protocols import Denoiser


def reset(denoiser: Any) -> None:
    """Make a denoiser forget earlier videos, if it has a memory."""
    forget = getattr(denoiser, "reset", None)
    if callable(forget):
        forget()


class Stages:
    """One denoiser after the other: each serves its number of calls, the last one all that follow.

    Parameters
    ----------
    stages : sequence of (denoiser, calls)

    Examples
    --------
    >>> halve, keep = (lambda x, sigma: x / 2), (lambda x, sigma: x)
    >>> stages = Stages([(halve, 1), (keep, 1)])
    >>> [float(stages(np.ones(1), 0.1)[0]) for _ in range(3)]
    [0.5, 1.0, 1.0]
    """

    def __init__(self, stages: Sequence[tuple[Denoiser, int]]):
        self.stages = list(stages)
        self.reset()

    @property
    def calls(self) -> int:
        """Of all stages together."""
        return sum(calls for _, calls in self.stages)

    def reset(self) -> None:
        """Begin with the first stage again."""
        self._called = 0
        for denoiser, _ in self.stages:
            reset(denoiser)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise with the stage whose turn it is."""
        ends = np.cumsum([calls for _, calls in self.stages])
        turn = min(int(np.searchsorted(ends, self._called, side="right")), len(self.stages) - 1)
        self._called += 1
        return self.stages[turn][0](x, sigma)


class Joint:
    """Several denoisers at once: the mean of what they return.

    The mean of proximal maps is, to first order in sigma^2, that of the mean of their priors, so this serves an
    objective such as ``||y - Phi x||^2 / 2 + a TV(x) + b Theta(x)``
    (Y. Yu, "Better approximation and faster algorithm using the proximal average", NIPS 2013).
    """

    def __init__(self, denoisers: Sequence[Denoiser]):
        self.denoisers = list(denoisers)
        self.learned = any(getattr(denoiser, "learned", False) for denoiser in self.denoisers)

    def reset(self) -> None:
        """Make all of them forget earlier videos."""
        for denoiser in self.denoisers:
            reset(denoiser)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W) with each and average."""
        total = np.array(self.denoisers[0](x, sigma))
        for denoiser in self.denoisers[1:]:
            total += denoiser(x, sigma)
        return total / x.dtype.type(len(self.denoisers))


class TorchDenoiser:
    """A ``torch.nn.Module`` called ``(x, sigma)`` as a denoiser of arrays.

    The module sees each frame as an image: (V * B, 1, H, W) float32 on `device`, and must return the same shape.
    """

    def __init__(self, module: Any, device: str | None = None):
        self.module = module.eval() if device is None else module.eval().to(device)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W)."""
        import torch

        device = next((p.device for p in self.module.parameters()), torch.device("cpu"))
        frames = torch.from_numpy(np.ascontiguousarray(x, np.float32)).reshape(-1, 1, *x.shape[2:]).to(device)
        with torch.inference_mode():
            out = self.module(frames, sigma)
        return out.reshape(x.shape).cpu().numpy().astype(x.dtype)


def is_torch_module(thing: Any) -> bool:
    """Whether this is a ``torch.nn.Module``, without importing torch."""
    return any(c.__module__.startswith("torch.nn") and c.__name__ == "Module" for c in type(thing).__mro__)
