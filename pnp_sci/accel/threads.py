"""Limits on the number of threads of numba's kernels, BLAS, OpenCV and torch."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numba
from threadpoolctl import threadpool_limits


class Pool:
    """A thread pool of the whole process, limited while a context is open; the last one to close restores the limit.

    Parameters
    ----------
    hold : callable
        ``hold(threads)`` sets the limit and returns a function that restores the earlier one.
    """

    def __init__(self, hold: Callable[[int], Callable[[], object]]):
        self._hold, self._lock, self._asked = hold, threading.Lock(), list[int]()
        self._put_back: Callable[[], object] | None = None

    @contextmanager
    def at_most(self, threads: int) -> Iterator[None]:
        """Context with at most `threads` threads; of several open contexts, the smallest limit holds."""
        with self._lock:
            undo = self._hold(min([threads, *self._asked]))
            if not self._asked:
                self._put_back = undo
            self._asked.append(threads)
        try:
            yield
        finally:
            with self._lock:
                self._asked.remove(threads)
                if self._asked:
                    self._hold(min(self._asked))
                elif self._put_back:
                    self._put_back()


_blas = Pool(lambda threads: threadpool_limits(threads, user_api="blas").restore_original_limits)


@contextmanager
def limited(threads: int | None) -> Iterator[None]:
    """Context with at most `threads` threads; None changes nothing.

    The limits of numba and OpenMP apply to the calling thread only. The limit of BLAS applies to the process, and the
    smallest one holds. Networks and optical flow use numba's limit, see
    :func:`pnp_sci.accel.inference.as_many_threads`.
    """
    if threads is None:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, before))
    try:
        most = min(threads, numba.config.NUMBA_NUM_THREADS)  # type: ignore[attr-defined]
        with _blas.at_most(most), threadpool_limits(most, user_api="openmp"):
            yield
    finally:
        numba.set_num_threads(before)
