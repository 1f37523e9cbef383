"""A prior does the same whether it comes by name or as an object, in still, dark and moving scenes."""

import numpy as np
import pytest
from operators_and_priors import learned

import pnp_sci
from pnp_sci import datasets
from priors.bm3d import BM3D
from priors.desci import DeSCI
from priors.flow import Flow
from priors.tv import TV
from priors.video import Video
from priors.wavelet import Wavelet

OWN = {"prior", "seconds"}  # settings that tell a name from an object, or one run from the next


def scenes():
    """Truths of three scenes (2, 10, 64, 64): one moves, one stands still, and the second view of one is dark."""
    moving = datasets.embedded_scene(64).truth
    still = np.repeat(moving[:, 4:5], moving.shape[1], axis=1)
    dark = moving.copy()
    dark[1] = 0
    return {"moving": moving, "still": still, "dark": dark}


@pytest.mark.parametrize("scene", ["moving", "still", "dark"])
@pytest.mark.parametrize(
    ("name", "prior"),
    [
        pytest.param("tv", TV(), id="tv"),
        pytest.param("wavelet", Wavelet(), id="wavelet"),
        pytest.param("bm3d", BM3D(), id="bm3d"),
        pytest.param("flow", Flow(), id="flow"),
        pytest.param("desci", DeSCI(), id="desci"),
        learned("video", Video(), name="video"),
    ],
)
def test_the_same_bits_and_the_same_scene(name, prior, scene):
    masks = datasets.embedded_scene(64).masks
    y = pnp_sci.simulate(scenes()[scene], masks)
    by_name, by_object = (pnp_sci.solve(y, masks, p, iterations=70) for p in (name, prior))
    assert np.array_equal(by_name.x, by_object.x)
    assert by_name.scenes == by_object.scenes
    assert by_name.status == by_object.status
    assert np.array_equal(by_name.history["residual"], by_object.history["residual"])
    assert set(by_name.settings) == set(by_object.settings)
    for key in set(by_name.settings) - OWN:
        assert by_name.settings[key] == by_object.settings[key], key


def test_the_scenes_are_what_they_are_called():
    """Else the same scene in both is found for nothing."""
    masks = datasets.embedded_scene(64).masks
    found = {
        name: pnp_sci.solve(pnp_sci.simulate(truth, masks), masks, "tv", iterations=1).scene
        for name, truth in scenes().items()
    }
    assert found["still"]["still"]
    assert not found["moving"]["still"]
    assert list(found["dark"]["views"]) == [True, False]
