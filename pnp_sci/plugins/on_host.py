"""A session that runs on the CPU, for a solver whose arrays are tensors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.plugins.protocols import Session


class OnHost(Session):
    """Copies tensors to the CPU for a session that takes arrays, and back to their device.

    Parameters
    ----------
    session : Session
        Takes arrays of numpy.
    """

    def __init__(self, session: Session):
        self.session = session

    def __call__(self, v: Any, sigma: Any, out: Any = None) -> Any:
        """Denoise the tensor v (V, B, H, W); a new tensor. `sigma` is what the session takes, maybe as a tensor."""
        told = sigma if isinstance(sigma, (int, float)) else sigma.numpy(force=True)
        return _through(lambda array: self.session(array, told, out=array), v)

    def finish(self, x: Any, sigma: float) -> Any:
        """As the session does, for a tensor x (V, B, H, W)."""
        return _through(lambda array: self.session.finish(array, sigma), x)

    def facts(self) -> Mapping[str, Any]:
        """Those of the session."""
        return self.session.facts()


def _through(function: Callable[[np.ndarray], Any], tensor: Any) -> Any:
    """The tensor that a function of arrays makes of a tensor, which stays as it is."""
    import torch

    array = tensor.numpy(force=True).copy()
    made = shaped("what the prior returns", function(array), array.shape, array.dtype)
    return torch.from_numpy(made).to(tensor)
