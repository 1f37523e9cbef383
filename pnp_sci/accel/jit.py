"""The decorator of all numba kernels: compiled on first use, cached on disk, parallel for large inputs.

Each kernel is compiled twice, serial and parallel, from one function. The serial version is used for small inputs and
for one thread. It is also used in a second Python thread if numba's threading layer is the work queue, which is not
reentrant.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba

# Shorter spinning of idle threads in GNU OpenMP, which slows down a loaded machine. OpenMP reads it when it is loaded.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")

PARALLEL_FROM = 32_768  # elements of the largest argument from which the parallel version is faster
FASTMATH = {"contract", "nsz", "arcp"}  # without nnan and ninf: the solver tests for NaN and inf


def _twin(function: FunctionType, suffix: str) -> FunctionType:
    """A copy of the function with another name, because numba's disk cache identifies kernels by name."""
    twin = FunctionType(function.__code__, function.__globals__, function.__name__ + suffix)
    twin.__qualname__ = function.__qualname__ + suffix
    twin.__module__ = function.__module__
    return twin


def _reentrant() -> bool:
    try:
        return numba.threading_layer() != "workqueue"  # pyright: ignore[reportPrivateImportUsage]
    except ValueError:  # no parallel kernel has run yet
        return threading.current_thread() is threading.main_thread()


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Decorator of a function with ``numba.prange`` loops: compiles it on its first call.

    The returned function has the same arguments. It calls the serial or the parallel version.
    """
    assert isinstance(function, FunctionType)
    options = {"cache": True, "fastmath": FASTMATH, "error_model": "numpy"}
    serial = numba.njit(**options)(_twin(function, "_serial"))
    parallel = numba.njit(parallel=True, **options)(_twin(function, "_parallel"))

    def dispatch(*args: Any) -> Any:
        small = max(getattr(a, "size", 1) for a in args) < PARALLEL_FROM
        alone = numba.get_num_threads() == 1
        second = threading.current_thread() is not threading.main_thread() and not _reentrant()
        return (serial if small or alone or second else parallel)(*args)

    dispatch.__name__, dispatch.__doc__ = function.__name__, function.__doc__
    return dispatch


device_function = numba.njit(inline="always", cache=True, fastmath=FASTMATH, error_model="numpy")

# Decorator of a plain loop over arrays. In a parallel region LLVM does not vectorise a loop that writes several arrays,
# as they may alias; in a function of its own it does.
loop = numba.njit(cache=True, fastmath=FASTMATH, error_model="numpy")
