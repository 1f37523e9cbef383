"""An estimated noise is lowered to what the denoised estimate of a decoder leaves."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.plugins import registry

NOISE = 0.01  # of the largest y


@pytest.fixture(scope="module")
def textured():
    """Two moving scenes with fine texture all over: masks, truth, y and the noise of y."""
    scene = pnp_sci.datasets.embedded_scene(128)
    grain = 0.06 * np.random.default_rng(0).standard_normal((2, 1, 160, 160))
    moving = np.concatenate([grain[..., 2 * b : 2 * b + 128, 3 * b : 3 * b + 128] for b in range(10)], 1)
    truth = np.clip(scene.truth + moving, 0, 1).astype(np.float32)
    y = pnp_sci.simulate(truth, scene.masks, NOISE, seed=4)
    return scene.masks, truth, y, NOISE * float(pnp_sci.simulate(truth, scene.masks).max())


@pytest.fixture
def good(textured, monkeypatch):
    """A decoder, known as "good", that knows half of the texture."""
    _, truth, _, _ = textured
    smooth = pnp_sci.denoise(truth, 0.1, "tv")
    monkeypatch.setitem(registry._registered["decoders"], "good", lambda: lambda *_: 0.5 * (truth + smooth))


OPTIONS = {"prior": "flow", "scene": "full", "iterations": 6}


def test_texture_that_a_decoder_explains_is_not_taken_for_noise(textured, good):
    masks, _, y, noise = textured
    result = pnp_sci.solve(y, masks, init="good", **OPTIONS)
    estimate = pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)
    used = result.settings["noise"][0]
    assert used < 0.8 * estimate
    assert used > 0.8 * noise
    before = pnp_sci.solve(y, masks, init="good", noise=estimate, **OPTIONS)
    assert result.settings["plan"][0]["rho"] < 0.8 * before.settings["plan"][0]["rho"]


@pytest.mark.parametrize("noise", [0.5, pnp_sci.Sensor(0.4, gain=0.01)])
def test_a_noise_that_is_known_stays(textured, good, noise):
    masks, _, y, _ = textured
    named, video = (pnp_sci.solve(y, masks, init=init, noise=noise, **OPTIONS).settings for init in ("good", "adjoint"))
    assert named["noise"] == video["noise"]
    assert named["plan"][0]["rho"] == video["plan"][0]["rho"]


@pytest.mark.parametrize(("prior", "init"), [("flow", "adjoint"), ("tv", "good")])
def test_without_a_decoder_and_a_strong_prior_the_estimate_stays(textured, good, prior, init):
    masks, _, y, _ = textured
    noise = pnp_sci.solve(y, masks, init=init, **OPTIONS | {"prior": prior}).settings["noise"][0]
    assert noise == pytest.approx(pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y), rel=1e-5)


def test_saturated_and_bad_pixels_say_nothing(textured, good):
    masks, _, y, _ = textured
    bad = np.random.default_rng(1).random(y.shape) < 0.1
    wild = np.where(bad, 1e3, np.minimum(y, np.quantile(y, 0.9)))
    sensor = pnp_sci.Sensor(full_scale=float(np.quantile(y, 0.9)))
    lowered = pnp_sci.solve(wild, masks, init="good", noise=sensor, bad=bad, **OPTIONS).settings["noise"][0]
    usual = pnp_sci.solve(y, masks, init="good", **OPTIONS).settings["noise"][0]
    assert lowered == pytest.approx(usual, rel=0.25)
