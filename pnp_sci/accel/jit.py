"""One decorator for all numba kernels: compiled on first use, cached on disk, parallel where that pays.

Each kernel exists twice, serial and parallel, made from one function. The serial one serves small inputs, one thread,
and calls from a second thread while the threading layer is numba's own work queue, which is not reentrant.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numba

# How long GNU's OpenMP lets a thread that has nothing to do go on spinning; it is read when the first parallel kernel
# loads it, unless torch has done so before. By default 30 times as long: no quicker on a machine with nothing else to
# do, but beside one other busy program TV takes 17 times as long as alone, and twice as long with this.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")

PARALLEL_FROM = 32_768  # elements of the largest array; below, starting threads costs more than they save
FASTMATH = {"contract", "nsz", "arcp"}  # NaN and inf keep their meaning: the guard has to see them


def _twin(function: FunctionType, suffix: str) -> FunctionType:
    """The same function under another name, because numba's disk cache tells kernels apart by name only."""
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
    """Compile `function` (which loops with ``numba.prange``) on its first call; return a dispatcher."""
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

# One plain loop over arrays, a function of its own: inside a parallel region LLVM does not vectorise it where several
# arrays are written, as it cannot tell them apart.
loop = numba.njit(cache=True, fastmath=FASTMATH, error_model="numpy")
