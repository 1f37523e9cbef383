"""Where a solve runs: the arguments `backend` and `device`."""

from __future__ import annotations

from pnp_sci._optional import needed_for
from pnp_sci._validate import one_of
from pnp_sci.solvers.backend import NUMBA, Backend

NAMES = ("numba", "torch")


def backend_for(name: str | None, device: str | None) -> Backend:
    """The backend of this name; by default "torch" for a device that is not the CPU, else "numba".

    Raises
    ------
    InputError
        If there is none of this name, or the device cannot be used.
    MissingExtraError
        If PyTorch is missing.

    Examples
    --------
    >>> backend_for(None, None).name, backend_for(None, "cpu").name
    ('numba', 'numba')
    """
    elsewhere = device is not None and device.split(":")[0] != "cpu"
    if name is None:
        name = "torch" if elsewhere else "numba"
    one_of("backend", name, NAMES)
    if name == "numba" and not elsewhere:
        return NUMBA
    with needed_for("backend 'torch'" if name == "torch" else f"device {device!r}", "learned"):
        from pnp_sci.solvers.torch_backend import TorchBackend
    placed = TorchBackend.on(device)  # an error if the device cannot be used
    return placed if name == "torch" else NUMBA
