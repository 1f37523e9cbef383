"""Priors made of priors: stages one after the other, several at once, and modules of torch."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from numbers import Integral
from typing import Any

import numpy as np

from pnp_sci._validate import number
from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Denoiser

FIRST = 30  # calls that a thorough prior leaves to something quick, where it does not tell


def reset(denoiser: Any) -> None:
    """Make a denoiser forget earlier videos, if it has a memory."""
    forget = getattr(denoiser, "reset", None)
    if callable(forget):
        forget()


def first_of(denoiser: Any) -> int | None:
    """How many calls a thorough or learned prior leaves to something quick; None of a plain one."""
    if not (getattr(denoiser, "learned", False) or getattr(denoiser, "thorough", False)):
        return None
    first = getattr(denoiser, "first", FIRST)
    return int(first) if isinstance(first, Integral) else FIRST


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

    def __repr__(self) -> str:
        return f"Stages({self.stages})"

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
    """Several denoisers at once: the mean of what they return, and of what they make of a last estimate, by `shares`.

    The mean of proximal maps is, to first order in sigma^2, that of the mean of their priors, so this serves an
    objective such as ``||y - Phi x||^2 / 2 + a TV(x) + b Theta(x)``
    (Y. Yu, "Better approximation and faster algorithm using the proximal average", NIPS 2013).

    Parameters
    ----------
    denoisers : sequence of denoiser
    shares : sequence of float, optional
        What each counts beside the others, > 0; by default all count the same.

    Raises
    ------
    InputError
        If there are not as many shares as denoisers, or one is not a number > 0.

    Examples
    --------
    >>> halve, keep = (lambda x, sigma: x / 2), (lambda x, sigma: x)
    >>> float(Joint([halve, keep], shares=[3, 1])(np.ones(1), 0.1)[0])
    0.625
    """

    def __init__(self, denoisers: Sequence[Denoiser], shares: Sequence[float] | None = None):
        self.denoisers = list(denoisers)
        self.shares = [1.0] * len(self.denoisers) if shares is None else [number("a share", share) for share in shares]
        if len(self.shares) != len(self.denoisers) or not all(self.shares):
            raise InputError(f"shares is {shares}: {len(self.denoisers)} numbers > 0 were expected")
        self.learned, self.thorough = (
            any(getattr(denoiser, name, False) for denoiser in self.denoisers) for name in ("learned", "thorough")
        )
        self.first = max(first_of(denoiser) or 0 for denoiser in self.denoisers)
        finishes = [getattr(denoiser, "finish", None) for denoiser in self.denoisers]
        that_do = [(finish, share) for finish, share in zip(finishes, self.shares) if callable(finish)]
        if that_do:
            self.finish = partial(_mean, that_do)

    def __repr__(self) -> str:
        return f"Joint({self.denoisers}, {self.shares})"

    def reset(self) -> None:
        """Make all of them forget earlier videos."""
        for denoiser in self.denoisers:
            reset(denoiser)

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W) with each and average."""
        return _mean(list(zip(self.denoisers, self.shares)), x, sigma)

    @property
    def restless(self) -> bool:
        """Whether one of them is."""
        return any(getattr(denoiser, "restless", False) for denoiser in self.denoisers)

    @property
    def at_rest(self) -> list[float]:
        """The part of each view that stands still, as the first of them says that knows."""
        return next((found for d in self.denoisers if (found := getattr(d, "at_rest", []))), [])


def _mean(members: list[tuple[Callable, float]], x: np.ndarray, sigma: float) -> np.ndarray:
    """The mean of what functions of (x, sigma) return, each with its share."""
    (first, _), *others = members
    total = sum(share for _, share in members)
    out = first(x, sigma)  # where all return the same, so does the mean, to the last digit
    return out + sum(share / total * (function(x, sigma) - out) for function, share in others)


class TorchDenoiser:
    """A ``torch.nn.Module`` called ``(x, sigma)`` as a denoiser of arrays.

    The module, from now on in evaluation mode, sees each frame as an image: (V * B, 1, H, W) float32 on its device, by
    default the one it is on; it must return the same shape.
    """

    def __init__(self, module: Any, device: str | None = None):
        from pnp_sci.accel.inference import usable

        self.learned = bool(getattr(module, "learned", False))
        self.module = module.eval() if device is None else module.eval().to(usable(device))
        first = next((t for t in (*self.module.parameters(), *self.module.buffers())), None)
        self.device = usable(device) if first is None else first.device

    def __repr__(self) -> str:
        return repr(self.module)

    def reset(self) -> None:
        """Make the module forget earlier videos, if it has a memory: ``reset()``, or ``restart`` as deepinv's have."""
        reset(self.module)
        if hasattr(self.module, "restart"):
            self.module.restart = True

    def __call__(self, x: np.ndarray, sigma: float) -> np.ndarray:
        """Denoise x (V, B, H, W)."""
        import torch

        from pnp_sci.accel.inference import as_many_threads

        frames = torch.tensor(x.reshape(-1, 1, *x.shape[2:]), dtype=torch.float32, device=self.device)
        with as_many_threads(), torch.inference_mode():
            out = self.module(frames, sigma)
        if getattr(out, "shape", None) != frames.shape:
            came = tuple(out.shape) if isinstance(out, torch.Tensor) else type(out).__name__
            raise InputError(f"prior {type(self.module).__name__} returns {came}: {tuple(frames.shape)} was expected")
        return out.reshape(x.shape).cpu().numpy().astype(x.dtype)


def weights_of(denoiser: Any) -> list[str]:
    """Hashes of the weights of all networks in a denoiser, which read them if nothing has."""
    parts = getattr(denoiser, "denoisers", None) or [stage for stage, _ in getattr(denoiser, "stages", ())]
    own = [denoiser.sha256] if isinstance(getattr(type(denoiser), "sha256", None), property) else []
    return own + [digest for part in parts for digest in weights_of(part)]


def is_torch_module(thing: Any) -> bool:
    """Whether this is a ``torch.nn.Module``, without importing torch."""
    return any(c.__module__.startswith("torch.nn") and c.__name__ == "Module" for c in type(thing).__mro__)
