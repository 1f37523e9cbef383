"""Settings and fixtures of all tests; lists of operators and priors are in operators_and_priors.py."""

import os
from pathlib import Path

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
