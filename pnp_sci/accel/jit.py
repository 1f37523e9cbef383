"""The decorator of all numba kernels: compiled on first use, cached on disk, parallel for large inputs.

Each kernel is compiled twice, serial and parallel, from one function. The serial version is used for small inputs and
for one thread. It is also used in a second Python thread if numba's threading layer is the work queue, which is not
reentrant, and in a process that was forked after threads had been started: they exist in the parent only.

Where the disk cache cannot be read or written, kernels are compiled in each process.
"""

from __future__ import annotations

import logging
import os
import pickle
import threading
from collections.abc import Callable
from functools import cache, partial
from types import FunctionType
from typing import Any

import numba
from numba.core.caching import FunctionCache

# Shorter spinning of idle threads in GNU OpenMP, which slows down a loaded machine. OpenMP reads it when it is loaded.
if "OMP_WAIT_POLICY" not in os.environ:
    os.environ.setdefault("GOMP_SPINCOUNT", "10000")

PARALLEL_FROM = 32_768  # elements of the largest argument from which the parallel version is faster
FASTMATH = {"contract", "nsz", "arcp"}  # without nnan and ninf: the solver tests for NaN and inf

_log = logging.getLogger("pnp_sci")
_forked = False  # whether this process was forked from one whose threads numba had started


class _Cache(FunctionCache):
    """Numba's disk cache, which does without what it cannot read or write, such as on a full disk."""

    def load_overload(self, *args: Any) -> Any:
        try:
            return super().load_overload(*args)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            return _warn_once(str(error))

    def save_overload(self, *args: Any) -> Any:
        try:
            return super().save_overload(*args)
        except OSError as error:
            return _warn_once(str(error))


@cache
def _warn_once(why: str) -> None:
    _log.warning(
        "compiled code cannot be kept, so that each process compiles anew, which takes minutes for some priors (%s); "
        "set NUMBA_CACHE_DIR to a folder that can be written to",
        why,
    )


def compiled(function: Callable[..., Any], **options: Any) -> Any:
    """``numba.njit`` with the disk cache, where there is a place for it."""
    made: Any = numba.njit(**{"fastmath": FASTMATH, "error_model": "numpy"} | options)(function)
    try:
        made._cache = _Cache(function)
    except (RuntimeError, OSError):  # neither the folder of the code nor one of the user's can be written to
        _warn_once("there is no folder for it")
    return made


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
    serial = compiled(_twin(function, "_serial"))
    parallel = compiled(_twin(function, "_parallel"), parallel=True)

    def dispatch(*args: Any) -> Any:
        small = max(getattr(a, "size", 1) for a in args) < PARALLEL_FROM
        alone = numba.get_num_threads() == 1
        second = threading.current_thread() is not threading.main_thread() and not _reentrant()
        return (serial if small or alone or second or _forked else parallel)(*args)

    dispatch.__name__, dispatch.__doc__ = function.__name__, function.__doc__
    return dispatch


device_function = partial(compiled, inline="always")

# Decorator of a plain loop over arrays. In a parallel region LLVM does not vectorise a loop that writes several arrays,
# as they may alias; in a function of its own it does.
loop = compiled
summing = partial(compiled, fastmath=FASTMATH | {"reassoc"})  # a loop whose sums LLVM may reorder


def _in_forked_child() -> None:
    global _forked
    try:
        numba.threading_layer()  # pyright: ignore[reportPrivateImportUsage]
    except ValueError:  # no thread has been started: the child starts its own
        return
    _forked = True
    numba.set_num_threads(1)  # networks and optical flow follow it


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_in_forked_child)
