"""How many threads compute: one number for numba's kernels, BLAS, OpenCV and torch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba
from threadpoolctl import threadpool_limits


@contextmanager
def limited(threads: int | None) -> Iterator[None]:
    """Hold what is computed inside to so many threads at most, None for no change; afterwards all is as before.

    Networks and optical flow ask numba how many there are, see :func:`pnp_sci.inference.as_many_threads`. The limit of
    numba's kernels is this thread's own: solvers in other threads of the program keep theirs.
    """
    if threads is None:
        yield
        return
    before = numba.get_num_threads()
    numba.set_num_threads(min(threads, before))
    try:
        with threadpool_limits(min(threads, numba.config.NUMBA_NUM_THREADS)):  # type: ignore[attr-defined]
            yield
    finally:
        numba.set_num_threads(before)
