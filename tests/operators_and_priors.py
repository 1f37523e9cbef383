"""The operators and priors that the contracts run over: ``from operators_and_priors import OPERATORS, PRIORS``.

pytest puts this folder on the path, because of the conftest.py in it.
"""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

import priors
from priors.bm3d import BM3D
from priors.desci import DeSCI
from priors.ffdnet import FFDNet
from priors.flow import Flow
from priors.tv import TV
from priors.video import Video
from priors.wavelet import Wavelet

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

WEIGHTS = Path(priors.__file__).parent / "weights"
NETWORKS = ("ffdnet", "video")  # names of priors, and of the weights they need


def learned(*values, name, weights="video"):
    """A parameter of a test that is skipped where torch or the weights are missing."""
    there = find_spec("torch") is not None and (WEIGHTS / f"{weights}.safetensors").is_file()
    missing = pytest.mark.skipif(not there, reason=f"no torch, or no weights of {weights}")
    return pytest.param(*values, id=name, marks=missing)


def by_name(name, *values):
    """A parameter of a test, the name of a prior and maybe values: skipped where its network cannot run."""
    if name in NETWORKS:
        return learned(name, *values, name=name, weights=name)
    return pytest.param(name, *values, id=name)


CLASSICAL = [  # what is smooth already stays as it is
    pytest.param(TV(), id="tv"),
    pytest.param(TV(time=0), id="tv frame by frame"),
    pytest.param(TV(time=0.3, inner=5), id="tv time 0.3"),
    pytest.param(TV(isotropic=False), id="tv anisotropic"),
    pytest.param(TV(isotropic=False, time=0), id="tv anisotropic frame by frame"),
    pytest.param(Wavelet(), id="wavelet"),
    pytest.param(Wavelet(wavelet="haar", time=0, shifts=2), id="haar frame by frame"),
    pytest.param(Wavelet(wavelet="bior4.4", time=3, levels=5), id="wavelet deep in time"),
    pytest.param(BM3D(), id="bm3d"),
    pytest.param(DeSCI(), id="desci"),
]
PRIORS = [
    *CLASSICAL,
    pytest.param(Flow(), id="flow"),
    pytest.param(Flow(neighbours=1, still=False), id="flow of next neighbours"),
    learned(FFDNet(), name="ffdnet", weights="ffdnet"),
    learned(Video(), name="video"),
]
