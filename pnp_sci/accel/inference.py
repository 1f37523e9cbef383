"""Device and precision of networks.

This module imports torch; :mod:`pnp_sci` imports it on first use only.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import numba
import torch
from torch import nn

from pnp_sci._validate import shown
from pnp_sci.accel.fusion import fuse
from pnp_sci.errors import InputError


def usable(device: str | None) -> torch.device:
    """The torch device of this name, by default the CPU; raises InputError if it cannot be used."""
    try:
        place = torch.device(device or "cpu")
        with mixed_precision(place):
            (torch.zeros(1, device=place) + 1).cpu()  # "meta" and others have tensors, but no values
    except (RuntimeError, AssertionError, ImportError, AttributeError) as error:
        why = (str(error).splitlines() or [type(error).__name__])[0]
        raise InputError(f"device: {shown(device)} cannot be used here: {why}") from error
    return place


Net = TypeVar("Net", bound=nn.Module)


def ready(network: Net, device: torch.device) -> Net:
    """Prepare `network` for inference on `device`, in place, and return it; it cannot be trained afterwards."""
    network.eval().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    if device.type == "cpu":
        fuse(network, torch.bfloat16 if half_precision(device) else torch.float32)
    return network


@contextmanager
def running(device: torch.device) -> Iterator[None]:
    """Context for calls of networks that are :func:`ready`: no gradients, and the precision of the device."""
    with as_many_threads(), torch.inference_mode(), mixed_precision(device):
        yield


@contextmanager
def as_many_threads() -> Iterator[None]:
    """Context in which torch uses at most numba's number of threads, which ``solve(threads=...)`` may limit."""
    before = torch.get_num_threads()
    if before <= numba.get_num_threads():
        yield
        return
    torch.set_num_threads(numba.get_num_threads())
    try:
        yield
    finally:
        torch.set_num_threads(before)


def mixed_precision(device: torch.device) -> torch.autocast:
    """Context of mixed precision: bfloat16 if :func:`half_precision`, else float32."""
    return torch.autocast(device.type, torch.bfloat16, enabled=half_precision(device))


def half_precision(device: torch.device) -> bool:
    """Whether `device` has native bfloat16 arithmetic; where it is emulated, float32 is faster."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    native = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")  # private; some versions lack them
    return device.type == "cpu" and any(getattr(torch.cpu, name, bool)() for name in native)
