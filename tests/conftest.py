"""What the tests share: one list of masks and one of priors drive the contracts."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

import priors
from priors import assisted
from priors.bm3d import BM3D
from priors.both import Both
from priors.ffdnet import FFDNet
from priors.flow import Flow
from priors.tv import TV
from priors.video import VideoDenoiser
from priors.wavelet import Wavelet

settings.register_profile("ci", max_examples=15, deadline=None, derandomize=True)
settings.load_profile("ci")

_random = np.random.default_rng(7)
_DEAD = _random.random((2, 3, 5, 6)) < 0.5
_DEAD[:, :, 2, 3] = False  # in both views
_DEAD[1, :, 4, 0] = False  # in one

OPERATORS = {
    "binary": _random.random((2, 10, 9, 7)) < 0.5,
    "one view": _random.integers(0, 2, (1, 8, 6, 6), np.uint8),
    "grey, three views": _random.random((3, 4, 5, 8), np.float32),
    "signed": _random.standard_normal((2, 3, 4, 5)),
    "counts": _random.integers(0, 1000, (2, 3, 4, 5)).astype(np.uint16),
    "dead pixels": _DEAD,
    "64 frames": _random.random((1, 64, 3, 3)) < 0.5,
    "one frame": np.ones((2, 1, 4, 4), np.uint8),
    "one row": _random.random((2, 3, 1, 9)) < 0.5,
    "one column": _random.random((2, 3, 9, 1)) < 0.5,
    "one pixel": np.ones((1, 2, 1, 1), np.uint8),
}

_WEIGHTS = Path(priors.__file__).parent / "weights"


def _learned(make, name, weights):
    missing = not (_WEIGHTS / f"{weights}.safetensors").is_file()
    return pytest.param(make, id=name, marks=pytest.mark.skipif(missing, reason=f"no weights for {weights} yet"))


CLASSICAL = [  # what is smooth already stays as it is
    pytest.param(TV, id="tv"),
    pytest.param(lambda: TV(time=0), id="tv frame by frame"),
    pytest.param(lambda: TV(time=0.3, inner=5), id="tv time 0.3"),
    pytest.param(lambda: TV(isotropic=False), id="tv anisotropic"),
    pytest.param(lambda: TV(isotropic=False, time=0), id="tv anisotropic frame by frame"),
    pytest.param(Wavelet, id="wavelet"),
    pytest.param(lambda: Wavelet(wavelet="haar", time=0, shifts=2), id="haar frame by frame"),
    pytest.param(lambda: Wavelet(wavelet="bior4.4", time=3, levels=5), id="wavelet deep in time"),
    pytest.param(lambda: BM3D(first=0), id="bm3d"),
]
PRIORS = [
    *CLASSICAL,
    pytest.param(BM3D, id="tv, then bm3d"),
    pytest.param(Flow, id="flow"),
    pytest.param(lambda: Flow(first=0), id="flow from the start"),
    _learned(FFDNet, "ffdnet", "ffdnet"),
    _learned(VideoDenoiser, "video", "video"),
    _learned(lambda: assisted.ffdnet(first=0), "assisted ffdnet", "ffdnet"),
    _learned(lambda: assisted.video(first=0), "assisted video", "video"),
    _learned(lambda: Both(first=0), "both", "video"),
]


@pytest.fixture(scope="session")
def data():
    """The folder with the data sets of the field; a test that needs it is skipped where there is none."""
    folder = os.environ.get("PNP_SCI_DATA")
    if not folder or not (Path(folder) / "dualview").is_dir():
        pytest.skip("PNP_SCI_DATA names no folder with the data sets")
    return Path(folder)
