"""Where networks run, and in which precision.

This module imports torch; nothing in :mod:`pnp_sci` imports it before it is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeVar

import numba
import torch
from torch import nn

from pnp_sci.accel.fusion import fuse
from pnp_sci.errors import InputError


def usable(device: str | None) -> torch.device:
    """The device of that name, the CPU by default; raises InputError if it cannot be used here."""
    try:
        place = torch.device(device or "cpu")
        torch.empty(0, device=place)
    except (RuntimeError, AssertionError) as error:
        raise InputError(f"device: {device!r} cannot be used here: {str(error).splitlines()[0]}") from error
    return place


Net = TypeVar("Net", bound=nn.Module)


def ready(network: Net, device: torch.device) -> Net:
    """The network itself, on its device, as it is quickest there; it learns no more."""
    network.eval().to(device, memory_format=torch.channels_last)  # type: ignore[call-overload]
    if device.type == "cpu":
        fuse(network, torch.bfloat16 if half_precision(device) else torch.float32)
    return network


@contextmanager
def running(device: torch.device) -> Iterator[None]:
    """Meanwhile, networks that are :func:`ready` may be called: without gradients, and in half precision if quicker."""
    with as_many_threads(), torch.inference_mode(), mixed_precision(device):
        yield


@contextmanager
def as_many_threads() -> Iterator[None]:
    """Let torch use no more threads than numba's kernels do, which ``solve(threads=...)`` may have limited."""
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
    """Meanwhile, networks work in half precision if `device` is quicker in that."""
    return torch.autocast(device.type, torch.bfloat16, enabled=half_precision(device))


def half_precision(device: torch.device) -> bool:
    """Whether `device` multiplies bfloat16 natively; where it must be emulated, float32 is quicker."""
    if device.type == "cuda":
        return torch.cuda.is_bf16_supported(including_emulation=False)
    native = ("_is_avx512_bf16_supported", "_is_amx_tile_supported")  # private, and absent from some versions of torch
    return device.type == "cpu" and any(getattr(torch.cpu, name, bool)() for name in native)
