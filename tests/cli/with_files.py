"""Fixtures of folders and files for the commands, as a plugin of pytest."""

import pytest

from pnp_sci import io
from pnp_sci.datasets import embedded_scene


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def meas(here):
    """A file with y, its masks and the true video."""
    scene = embedded_scene(32)
    io.write("meas.npz", {"y": scene.y, "masks": scene.masks, "x": scene.truth})
    return "meas.npz"
