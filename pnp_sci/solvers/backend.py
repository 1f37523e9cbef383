"""Where the arrays of a solver are: in numpy with numba's kernels, or in torch on a device."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import Any

from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.solvers.state import Operator


@dataclass(frozen=True)
class Backend:
    """Arrays of numpy, and numba's kernels.

    Attributes
    ----------
    device : str or None
        The torch device on which arrays are; None for arrays of numpy.
    """

    device: str | None = None

    @property
    def name(self) -> str:
        """ "numba" or "torch"."""
        return "numba" if self.device is None else "torch"

    def operator(self, op: SensingOperator) -> Operator:
        """The operator for arrays of this backend."""
        return op

    def put(self, value: Any) -> Any:
        """An array, as arrays are here; numbers and None as they are."""
        return value

    def get(self, array: Any) -> Any:
        """An array of this backend as one of numpy."""
        return array

    def running(self) -> AbstractContextManager[Any]:
        """Context of all that is done with arrays of this backend."""
        return nullcontext()


NUMBA = Backend()
