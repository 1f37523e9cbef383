"""Solvers in torch, on the CPU or on a GPU.

This module imports torch; :mod:`pnp_sci` imports it on first use only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from pnp_sci.accel.inference import as_many_threads, usable
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.sequence import SequenceOperator
from pnp_sci.sensing.torch_operator import TorchSensingOperator, TorchSequenceOperator
from pnp_sci.solvers.backend import Backend


@dataclass(frozen=True)
class TorchBackend(Backend):
    """Tensors on a device. Within the loop only scalars leave it, and residuals where the noise is estimated.

    Examples
    --------
    >>> backend = TorchBackend.on("cpu")
    >>> backend.put(np.ones((2, 2))).sum().item()
    4.0
    """

    device: str = "cpu"

    @classmethod
    def on(cls, device: str | None) -> TorchBackend:
        """The backend on a device, by default the CPU; an InputError if it cannot be used."""
        return cls(str(usable(device)))

    def operator(self, op: SensingOperator) -> TorchSensingOperator | TorchSequenceOperator:
        """The operator on the device."""
        if isinstance(op, SequenceOperator):
            return TorchSequenceOperator(op, self.device)
        return TorchSensingOperator(op, device=self.device)

    def put(self, value: Any) -> Any:
        """An array of numpy as a tensor on the device; never one that shares its memory."""
        return torch.tensor(value, device=self.device) if isinstance(value, np.ndarray) else value

    def get(self, array: Any) -> Any:
        """A tensor as an array of numpy."""
        return array.numpy(force=True)

    @contextmanager
    def running(self) -> Iterator[None]:
        """Context without gradients, with at most numba's number of threads on a CPU."""
        with as_many_threads(), torch.inference_mode():
            yield
