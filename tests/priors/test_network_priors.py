"""The priors with networks inside a solver: ffdnet and video, by the weights of this package."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import as_prior, datasets, denoise
from pnp_sci.errors import DataUnavailableError, InputError
from pnp_sci.plugins.combine import turns
from priors.ffdnet import FFDNet
from priors.flow import Flow
from priors.networks import along_motion
from priors.tv import TV
from priors.video import Video

pytest.importorskip("torch")

NAMED = {"ffdnet": FFDNet, "video": Video}


def quality(scene, prior, **options):
    """PSNR of each view in dB, where all views and frames are modelled."""
    return pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, prior, scene="full", **options).x, scene.truth)


@pytest.mark.parametrize("name", NAMED)
def test_total_variation_serves_first(name):
    """For as many calls as `first` says."""
    shape = (2, 4, 40, 40)
    warm, own = turns(as_prior(name, first=7), shape)
    assert (warm.prior, warm.begins) == (TV(), 0)
    assert own.begins == 7
    assert [type(turn.prior) for turn in turns(as_prior(name, first=0), shape)] == [NAMED[name]]


def test_a_later_stage_begins_with_the_network():
    order = turns(as_prior([("ffdnet", 2), ("ffdnet", 3), ("tv", 1)]), (1, 2, 8, 8))
    assert [(turn.prior, turn.begins) for turn in order] == [(TV(), 0), (FFDNet(), 2), (TV(), 5)]
    warmed = turns(as_prior([("video", 61), ("flow", 3)]), (1, 2, 8, 8))
    assert [(type(turn.prior), turn.begins) for turn in warmed][-1] == (Flow, 61)


@pytest.mark.parametrize("kind", NAMED.values())
@pytest.mark.parametrize("first", [-1, 1.5, "many"])
def test_an_unfit_first_is_named(kind, first):
    with pytest.raises(InputError, match=r"first is.*>= 0"):
        kind(first=first)


@pytest.mark.parametrize("renew", [0, 2.5])
def test_an_unfit_renew_is_named(renew):
    with pytest.raises(InputError, match=r"renew is.*>= 1"):
        Video(renew=renew)


@pytest.mark.parametrize("renew", [1, 3])
def test_the_motion_is_measured_in_every_so_many_calls(monkeypatch, renew):
    calls, own = [], along_motion.see
    monkeypatch.setattr(along_motion, "see", lambda *given: calls.append(1) or own(*given))
    x = datasets.embedded_scene(32).truth.astype(np.float32)
    session = Video(renew=renew).begin(x.shape, x.dtype)
    for _ in range(6):
        session(x, 0.05)
    assert len(calls) == 6 // renew


def test_a_network_from_the_start_keeps_blacks_and_whites():
    """Early estimates are nearly the mean: their range must not bind later ones."""
    scene = datasets.embedded_scene(64)
    from_the_start, after_tv = (
        pnp_sci.solve(scene.y, scene.masks, "ffdnet", iterations=60, first=first, scene="full", reference=scene.truth)
        for first in (0, 30)
    )
    assert from_the_start.history[-1].psnr > after_tv.history[-1].psnr - 0.3
    assert from_the_start.x.min() < 0.05


def test_a_result_says_which_weights_made_it():
    scene = datasets.embedded_scene(32)
    settings = pnp_sci.solve(scene.y, scene.masks, [("tv", 1), ("ffdnet", 1)]).settings
    session = FFDNet().begin((1, 1, 8, 8), np.dtype(np.float32))
    assert settings["weights"] == session.facts()["weights"]
    assert all(len(digest) == 64 for digest in settings["weights"])
    assert "torch" in settings["versions"]
    assert pnp_sci.solve(scene.y, scene.masks, "tv", iterations=1).settings["weights"] == []


def test_two_networks_are_both_recorded():
    x = datasets.embedded_scene(48).truth[:, :3].astype(np.float32)
    image, video = (prior.begin(x.shape, x.dtype).facts()["weights"] for prior in (FFDNet(), Video()))
    assert image != video
    together = pnp_sci.as_prior("ffdnet+video").begin(x.shape, x.dtype).facts()["weights"]
    assert together == [*image, *video]


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_five_hundred_iterations_are_stable(name):
    truth, masks = (a[:, :6, :40, :40] for a in (datasets.embedded_scene(64).truth, datasets.embedded_scene(64).masks))
    y = pnp_sci.simulate(truth, masks)
    settings = {"iterations": 500, "first": 30, "sigma": 5 / 255, "tol": 0, "scene": "full", "reference": truth}
    cold, warm = (pnp_sci.solve(y, masks, name, init, **settings).history["psnr"] for init in ("adjoint", "auto"))
    print(f"{name}: {cold.max():.2f} dB at best, {cold[-1]:.2f} in the end, {warm[-1]:.2f} from a network")
    assert cold[cold.argmax() :].min() > cold.max() - 0.7
    assert cold.argmax() > 30, "the network gains something"
    assert warm[-1] > cold[-1] - 0.1, "a better start may be used up in the end, but no more than that"


def test_video_is_better_than_flow_in_both_views():
    scene = datasets.embedded_scene(128)
    assert (quality(scene, "video") > quality(scene, "flow")).all()


@pytest.mark.parametrize(("effort", "prior"), [("fast", "tv"), ("balanced", "video"), ("best", "video")])
def test_what_auto_is(effort, prior):
    scene = datasets.embedded_scene(32)
    given = {"effort": effort, "noise": 0, "tol": 0, "callback": lambda state: True}
    auto, named = (pnp_sci.solve(scene.y, scene.masks, p, **given).settings for p in ("auto", prior))
    assert auto["prior"] == prior
    assert auto["iterations"] == named["iterations"]


@pytest.mark.parametrize("effort", ["balanced", "best"])
def test_auto_without_torch_is_flow(monkeypatch, effort):
    monkeypatch.setattr("pnp_sci.pipeline.auto.find_spec", lambda name: None)
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", effort=effort, iterations=2)
    assert result.settings["prior"] == "flow"


@pytest.mark.parametrize("size", [(2, 1, 40, 40), (2, 3, 24, 24)])
def test_video_is_ffdnet_where_nothing_shows_motion(size):
    x = datasets.embedded_scene(48).truth[:, : size[1], : size[2], : size[3]].astype(np.float32)
    video, ffdnet = (as_prior(name, first=2).begin(x.shape, x.dtype) for name in ("video", "ffdnet"))
    estimate = np.ascontiguousarray(x)
    for sigma in (0.1, 0.05, 0.05):
        expected = ffdnet(estimate, sigma)
        estimate = video(estimate, sigma)
        np.testing.assert_array_equal(estimate, expected)


@pytest.mark.parametrize("name", NAMED)
def test_both_precisions_are_served(name):
    x = np.random.default_rng(0).random((1, 3, 32, 32))
    assert [denoise(x.astype(t), 0.05, name).dtype.name for t in ("float64", "float32")] == ["float64", "float32"]


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_missing_weights_are_an_error_at_once(name, tmp_path):
    """And not after the iterations of total variation."""
    scene, seen = datasets.embedded_scene(32), []
    given = {"weights": tmp_path / "none.safetensors", "callback": lambda state: seen.append(state)}
    with pytest.raises(DataUnavailableError, match="weights"):
        pnp_sci.solve(scene.y, scene.masks, name, **given)
    assert not seen
