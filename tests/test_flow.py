"""The flow prior sees motion, helps where it can and keeps away where it cannot."""

from importlib.util import find_spec

import numpy as np
import pytest

import pnp_sci
from pnp_sci import datasets
from pnp_sci.errors import DataUnavailableError, InputError
from priors import flow
from priors.assisted import NOISY
from priors.flow import Flow
from priors.flow_ffdnet import FlowFFDNet
from priors.motion import measure
from priors.tv import TV

KINDS = [Flow, *([FlowFFDNet] if find_spec("torch") else [])]


@pytest.fixture(scope="module")
def moving():
    """A textured picture that moves by (1, 2) pixels a frame: (1, 7, 96, 96)."""
    picture = datasets.embedded_scene(128).truth[0, 0]
    frames = [np.roll(picture, (b, 2 * b), (0, 1))[14:110, 14:110] for b in range(7)]
    return np.stack(frames)[None].astype(np.float32)


def test_the_flow_is_that_of_the_scene(moving):
    motion = measure(moving[0], neighbours=2, tolerance=0.1, drift=1.5)
    for (b, n), field in zip(motion.pairs, motion.flow / 64):
        np.testing.assert_allclose(np.median(field, axis=(0, 1)), (2 * (n - b), n - b), atol=0.1)


def test_averaging_along_motion_keeps_the_scene_and_lowers_noise(moving):
    rng = np.random.default_rng(0)
    motion = measure(moving[0], neighbours=3, tolerance=0.2, drift=1.5)
    same, less = np.empty_like(moving[0]), np.empty_like(moving[0])
    motion.average(moving[0], same)
    inner = (slice(None), slice(16, -16), slice(16, -16))
    assert np.sqrt(np.mean((same - moving[0])[inner] ** 2)) < 0.02
    noise = 0.05 * rng.standard_normal(moving[0].shape).astype(np.float32)
    motion.average(moving[0] + noise, less)
    assert np.std((less - same)[inner]) < 0.6 * np.std(noise)


def test_strangers_do_not_help():
    """Frames without anything in common are left alone."""
    frames = np.random.default_rng(0).random((3, 64, 64)).astype(np.float32)
    motion = measure(frames, neighbours=2, tolerance=0.05, drift=1.5)
    assert motion.weights.mean() < 2.55


@pytest.mark.parametrize(("view", "at_least"), [(0, 1.0), (1, 0.0)])
def test_better_than_tv_in_the_solver(view, at_least):
    scene = datasets.embedded_scene(128)
    plain = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "tv").x, scene.truth)
    aided = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "flow").x, scene.truth)
    assert aided[view] > plain[view] + at_least


def test_benchmark_pair(data):
    scene = datasets.dualview("hike_hockey")
    psnr = pnp_sci.psnr(pnp_sci.solve(scene.y, scene.masks, "flow").x, scene.truth)
    assert psnr.mean() > 25.5


def test_begins_as_tv(moving):
    flow_prior, tv = Flow(), TV()
    np.testing.assert_array_equal(flow_prior(moving, 0.05), tv(moving, 0.05))


@pytest.mark.parametrize("kind", KINDS)
def test_views_do_not_mix_once_motion_is_used(moving, kind):
    """The contract of all priors sees the first calls only."""
    other = moving[:, ::-1]
    first, second = kind(), kind()
    for _ in range(flow.FIRST + 2):
        a = first(np.concatenate([moving, moving]), 0.05)
        b = second(np.concatenate([moving, other]), 0.05)
    np.testing.assert_array_equal(a[0], b[0])
    assert not np.array_equal(a[1], b[1])


@pytest.mark.parametrize("kind", KINDS)
def test_reset_and_another_size_begin_anew(moving, kind):
    prior = kind()
    first = prior(moving, 0.05)
    for _ in range(flow.FIRST):
        prior(moving, 0.05)
    prior.reset()
    np.testing.assert_array_equal(prior(moving, 0.05), first)
    for _ in range(flow.FIRST):
        prior(moving, 0.05)
    larger = np.concatenate([moving, moving])
    np.testing.assert_array_equal(prior(larger, 0.05), kind()(larger, 0.05))


@pytest.mark.parametrize("kind", KINDS)
def test_type_and_input_are_kept_once_motion_is_used(moving, kind):
    x = moving.astype(np.float64)
    before, prior = x.copy(), kind()
    for _ in range(flow.FIRST + 1):
        after = prior(x, 0.05)
    assert after.dtype == np.float64
    np.testing.assert_array_equal(x, before)
    again = kind()
    for _ in range(flow.FIRST + 1):
        into = again(x, 0.05, np.empty_like(x))
    np.testing.assert_array_equal(into, after)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("sigma", [1e-9, 1e-4, 1e3])
def test_any_sigma_once_motion_is_used(moving, sigma, kind):
    prior = kind()
    for _ in range(flow.FIRST):
        prior(moving, sigma)
    after = prior(moving, sigma)
    assert np.isfinite(after).all()
    if sigma < 1e-3:
        np.testing.assert_allclose(after, moving, atol=20 * sigma)


@pytest.mark.parametrize("option", [{"neighbours": 0}, {"neighbours": 1.5}, {"tolerance": 0}, {"drift": -1}])
def test_errors_name_the_option(option):
    with pytest.raises(InputError, match=next(iter(option))):
        Flow(**option)


def test_frames_may_have_a_denoiser_of_their_own(moving):
    """It is asked for every call once the motion is seen, and told of a new video."""
    asked = []

    class Frames:
        def reset(self):
            asked.append("reset")

        def __call__(self, x, sigma):
            asked.append(sigma)
            return x

    prior = Flow(frames=Frames())
    for _ in range(flow.FIRST + 2):
        prior(moving, 0.05)
    prior.reset()
    assert [a for a in asked if a != "reset"] == [0.05, 0.05]
    assert asked[-1] == "reset"


def test_a_network_for_the_frames_is_better_than_tv():
    """The same iterations up to the 30th; from there the network helps both views."""
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(96)
    plain, learned = (
        pnp_sci.solve(scene.y, scene.masks, prior, iterations=45, reference=scene.truth, scene="full")
        for prior in ("flow", "flow-ffdnet")
    )
    same = flow.FIRST + 1
    np.testing.assert_array_equal(plain.history["psnr"][:same], learned.history["psnr"][:same])
    assert (pnp_sci.psnr(learned.x, scene.truth) > pnp_sci.psnr(plain.x, scene.truth)).all()


@pytest.mark.parametrize(("effort", "iterations"), [("balanced", 50), ("best", 110)])
def test_auto_is_flow_and_network(effort, iterations):
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", effort=effort, noise=0, tol=0)
    assert result.settings["prior"] == "flow-ffdnet"
    assert result.settings["iterations"] == iterations


@pytest.mark.parametrize("effort", ["balanced", "best"])
def test_auto_without_torch_is_flow(monkeypatch, effort):
    monkeypatch.setattr("pnp_sci.api.find_spec", lambda name: None)
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", effort=effort, iterations=2)
    assert result.settings["prior"] == pnp_sci.solve(scene.y, scene.masks, "flow", iterations=2).settings["prior"]


def test_the_network_waits_while_a_large_sigma_falls(moving):
    pytest.importorskip("torch")
    falling = np.linspace(0.34, 1.01 * NOISY, flow.FIRST + 4)
    for sigmas, same in ((falling, True), ([*falling, falling[-1]], False), ([0.8 * NOISY, *falling * 0.5], False)):
        plain, learned = Flow(), FlowFFDNet()
        for sigma in sigmas:
            a, b = plain(moving, sigma), learned(moving, sigma)
        assert np.array_equal(a, b) == same


def test_options_of_flow_reach_it_with_the_network_too():
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "flow-ffdnet", neighbours=2, iterations=1)
    assert result.settings["prior_options"] == {"neighbours": 2}


def test_missing_weights_are_an_error_at_once(tmp_path):
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    with pytest.raises(DataUnavailableError, match="weights"):
        pnp_sci.solve(scene.y, scene.masks, "flow-ffdnet", weights=tmp_path / "none.safetensors", iterations=1)
