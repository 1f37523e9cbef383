"""How many threads compute: one number for numba's kernels, BLAS, OpenCV and torch."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numba
from threadpoolctl import threadpool_limits


class Pool:
    """Threads of the whole process, held to a number while anybody asks for it; the last who leaves puts them back.

    Parameters
    ----------
    hold : callable
        Holds them to so many, and returns what undoes that.
    """

    def __init__(self, hold: Callable[[int], Callable[[], object]]):
        self._hold, self._lock, self._asked = hold, threading.Lock(), list[int]()
        self._put_back: Callable[[], object] | None = None

    @contextmanager
    def at_most(self, threads: int) -> Iterator[None]:
        """Meanwhile, so many threads at most; fewer if others ask for fewer at the same time."""
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
    """Hold what is computed inside to so many threads at most, None for no change; afterwards all is as before.

    Networks and optical flow ask numba how many there are, see :func:`pnp_sci.accel.inference.as_many_threads`. The
    limits of numba's kernels and of OpenMP hold for this thread alone: solvers in other threads keep theirs. That of
    BLAS holds for the process, the lowest that is asked for.
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
