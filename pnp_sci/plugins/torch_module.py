"""A module of torch as a prior."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Prior, Session


@dataclass(frozen=True)
class TorchPrior(Prior):
    """A ``torch.nn.Module`` called ``(x, sigma)`` as a prior.

    Each session has a copy of the module in evaluation mode, so that what a module remembers is of one video. The copy
    sees each frame as an image, (V * B, 1, H, W) float32, and must return the same shape.

    Parameters
    ----------
    module : torch.nn.Module
    device : str, optional
        Where it runs; by default where its parameters are.
    """

    module: Any
    device: str | None = None

    def begin(self, shape: tuple[int, ...], dtype: np.dtype) -> Session:
        """A session with a copy of the module."""
        return _TorchSession(self.module, self.device)

    def begin_on(self, shape: tuple[int, ...], dtype: np.dtype, device: str) -> Session:
        """A session on tensors, with a copy of the module there."""
        return _TorchSession(self.module, device)


class _TorchSession(Session):
    def __init__(self, module: Any, device: str | None):
        from pnp_sci.accel.inference import usable

        copy = deepcopy(module).eval()
        if "restart" in vars(copy):  # deepinv's denoisers begin anew where this is set
            copy.restart = True
        tensor = next((t for t in (*copy.parameters(), *copy.buffers())), None)
        self.device = usable(device) if device is not None or tensor is None else tensor.device
        self.module = copy.to(self.device)

    def __call__(self, v: np.ndarray, sigma: float, out: np.ndarray | None = None) -> np.ndarray:
        import torch

        from pnp_sci.accel.inference import as_many_threads

        frames = torch.as_tensor(v, device=self.device).to(torch.float32, copy=True).reshape(-1, 1, *v.shape[2:])
        with as_many_threads(), torch.inference_mode():
            clean = self.module(frames, sigma)
        came = tuple(clean.shape) if isinstance(clean, torch.Tensor) else type(clean).__name__
        if came != tuple(frames.shape):
            raise InputError(f"prior {type(self.module).__name__} returns {came}: {tuple(frames.shape)} was expected")
        clean = clean.reshape(v.shape).float()
        return clean.cpu().numpy() if isinstance(v, np.ndarray) else clean


def is_torch_module(thing: Any) -> bool:
    """Whether this is a ``torch.nn.Module``, without importing torch."""
    return any(c.__module__.startswith("torch.nn") and c.__name__ == "Module" for c in type(thing).__mro__)
