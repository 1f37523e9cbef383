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
    if name is None:
        name = "numba" if device is None or device.split(":")[0] == "cpu" else "torch"
    one_of("backend", name, NAMES)
    if name == "numba":
        return NUMBA
    with needed_for("backend 'torch'", "learned"):
        from pnp_sci.solvers.torch_backend import TorchBackend
    return TorchBackend.on(device)
