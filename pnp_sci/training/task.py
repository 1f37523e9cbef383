"""The interface of a training task; its place and its progress."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import torch


@dataclass
class Progress:
    """State of training. seconds: time in steps, by the clock of process 0; rows: the curves."""

    step: int = 0
    seconds: float = 0.0
    rows: list[list[float]] = field(default_factory=list)


@dataclass(frozen=True)
class Place:
    """Rank of this process, number of processes, and device."""

    rank: int
    world: int
    device: torch.device

    @classmethod
    def here(cls, device: str = "auto") -> Place:
        """From the environment variables of torchrun; "auto" is CUDA if available, else the CPU."""
        if device == "auto":
            device = f"cuda:{os.environ.get('LOCAL_RANK', 0)}" if torch.cuda.is_available() else "cpu"
        return cls(int(os.environ.get("RANK", 0)), int(os.environ.get("WORLD_SIZE", 1)), torch.device(device))

    def hardware(self) -> str:
        """Describe the hardware without the name of the machine."""
        if self.device.type == "cuda":
            return f"{self.world} x {torch.cuda.get_device_name(self.device)}"
        capability = torch.backends.cpu.get_cpu_capability()
        threads = torch.get_num_threads()
        return f"CPU with {capability}, {os.cpu_count()} cores, {self.world} process(es) of {threads} thread(s)"


class Task(Protocol):
    """Interface between the loop and a training task: a network, its loss and its validation."""

    @property
    def name(self) -> str:
        """Name in the checkpoint; a resumed run must have the same."""
        ...

    @property
    def settings(self) -> str:
        """Description of the settings in the checkpoint; a resumed run must have the same."""
        ...

    @property
    def network(self) -> torch.nn.Module:
        """The trained network."""
        ...

    @property
    def scores(self) -> tuple[str, ...]:
        """Names of the scores of `validate`, columns of the curves."""
        ...

    @property
    def compiled(self) -> Sequence[torch.nn.Module]:
        """Modules to compile on CUDA."""
        ...

    def loss(self, model: torch.nn.Module, place: Place, step: int) -> torch.Tensor:
        """Loss of one batch, determined by rank and step; `model` is `network`, or its distributed wrapper."""
        ...

    def validate(self, network: torch.nn.Module, place: Place) -> torch.Tensor:
        """Sum of each score over the validation cases of this process, then the number of cases."""
        ...

    def state(self) -> dict[str, Any]:
        """What a resumed run needs beside network and step: tensors, numbers and containers of them."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` has returned."""
        ...

    def publish(self, network: torch.nn.Module, progress: Progress, place: Place) -> None:
        """Write the weights and the model card of `network`, which has the averaged weights."""
        ...
