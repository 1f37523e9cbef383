"""Settings and fixtures of all tests; lists of operators and priors are in operators_and_priors.py."""

import os
import sys
from pathlib import Path

import numba
import pytest
from hypothesis import settings

settings.register_profile("ci", max_examples=15, deadline=None, derandomize=True)
settings.load_profile("ci")


@pytest.fixture(scope="session")
def data():
    """The folder with the data sets of the field; a test that needs it is skipped where there is none."""
    folder = os.environ.get("PNP_SCI_DATA")
    if not folder or not (Path(folder) / "dualview").is_dir():
        pytest.skip("PNP_SCI_DATA names no folder with the data sets")
    return Path(folder)


@pytest.fixture(autouse=True)
def one_thread_a_worker(request):
    """Several workers of pytest-xdist share the cores; tests marked `threads` have all threads nevertheless."""
    if "PYTEST_XDIST_WORKER" not in os.environ or request.node.get_closest_marker("threads"):
        yield
        return
    numba.set_num_threads(1)  # inference follows it
    if "torch" in sys.modules:
        sys.modules["torch"].set_num_threads(1)
    yield
    numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
