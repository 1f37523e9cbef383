"""Reading in a child process: a library that crashes or hangs on a damaged file does not affect the caller."""

from __future__ import annotations

import json
import os
import select
import signal
import tempfile
import warnings
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import IO, NoReturn

import numpy as np

from pnp_sci.errors import FormatError

PATIENCE = 4.0  # seconds for a file, besides one for each SPEED bytes
SPEED = 1e6
NO_ROOM = 3  # exit code


def apart(work: Callable[[], Mapping[str, np.ndarray]], size: int) -> dict[str, np.ndarray]:
    """The arrays that `work` reads from a file of `size` bytes, in a forked child; here, where there is no fork.

    Raises
    ------
    FormatError
        If `work` raised one.
    ValueError
        If it raised another exception, crashed or took too long: the file may be damaged.
    """
    if not hasattr(os, "fork"):
        return dict(work())
    with tempfile.TemporaryFile() as result:
        limit = PATIENCE + size / SPEED
        ended, alive = os.pipe()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)  # of threads, which the child does not use
            child = os.fork()
        if child == 0:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(int(limit) + 1)  # it ends even where nobody waits for it any more
            _serve(work, result)
        os.close(alive)  # the child has the other end: it closes with the process
        in_time, died = False, 0
        try:
            waiting = select.poll()
            waiting.register(ended, select.POLLIN | select.POLLHUP)
            in_time = bool(waiting.poll(1000 * limit))
        finally:
            os.close(ended)
            if not in_time:
                os.kill(child, signal.SIGKILL)
            with suppress(ChildProcessError):  # where SIGCHLD is ignored, nobody need wait
                died = os.waitpid(child, 0)[1]
        if not in_time:
            raise ValueError(f"reading takes more than {limit:.0f} s")
        if os.waitstatus_to_exitcode(died) == NO_ROOM:
            raise ValueError(f"there is no room for its arrays in {tempfile.gettempdir()}")
        if died:
            raise ValueError("the library that reads this format crashes")
        return _received(result)


def _serve(work: Callable[[], Mapping[str, np.ndarray]], result: IO[bytes]) -> NoReturn:
    """In the child: write the arrays, or the error, and exit."""
    import fcntl

    try:
        # 2 is the file itself, if the process was started without stderr
        result = os.fdopen(fcntl.fcntl(result.fileno(), fcntl.F_DUPFD, 3), "wb")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)  # what libraries print when they crash
        try:
            arrays, error = work(), None
        except Exception as caught:
            arrays, error = {}, [isinstance(caught, FormatError), str(caught) or type(caught).__name__]
        header = json.dumps({"error": error, "names": list(arrays)}).encode()
        result.write(len(header).to_bytes(8, "little") + header)
        for array in arrays.values():
            np.lib.format.write_array(result, array, allow_pickle=False)
        result.flush()
    except OSError:
        os._exit(NO_ROOM)
    except BaseException:
        os._exit(1)
    os._exit(0)


def _received(result: IO[bytes]) -> dict[str, np.ndarray]:
    result.seek(0)
    header = json.loads(result.read(int.from_bytes(result.read(8), "little")))
    if header["error"]:
        known, message = header["error"]
        raise FormatError(message) if known else ValueError(message)
    return {name: np.lib.format.read_array(result, allow_pickle=False) for name in header["names"]}
