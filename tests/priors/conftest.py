"""What the tests of the trainers share."""

import imageio.v3 as iio
import numpy as np
import pytest


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder of four tiny clips of three scenes, and a photograph."""
    folder = tmp_path_factory.mktemp("clips")
    random = np.random.default_rng(0)
    for name in ("ball_1", "ball_2", "car", "dog"):
        frames = np.kron(random.integers(0, 256, (12, 8, 8, 1)), np.ones((1, 4, 4, 3))).astype(np.uint8)
        iio.imwrite(folder / f"{name}.mp4", frames, plugin="FFMPEG", fps=10)
    iio.imwrite(folder / "photograph.jpg", random.integers(0, 256, (40, 30), np.uint8))
    return folder


@pytest.fixture
def one_thread():
    """More of them only wait for each other on pictures this small."""
    torch = pytest.importorskip("torch")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)
