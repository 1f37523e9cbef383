"""An estimated noise is lowered to what the denoised estimate of a decoder leaves."""

from dataclasses import dataclass

import numpy as np
import pytest

import pnp_sci
from pnp_sci.pipeline import noise_left as module
from pnp_sci.pipeline import tiles
from pnp_sci.plugins import registry
from pnp_sci.plugins.protocols import Session, Traits

NOISE = 0.01  # of the largest y


@pytest.fixture(scope="module")
def textured():
    """Two moving scenes with a weave all over: masks, truth, y and the noise of y."""
    scene = pnp_sci.datasets.embedded_scene(128)
    rows, columns = np.indices((160, 160))
    weave = 0.2 * np.sin(2 * np.pi * rows / 7) * np.sin(2 * np.pi * columns / 9)
    moving = np.stack([weave[2 * b : 2 * b + 128, 3 * b : 3 * b + 128] for b in range(10)])
    truth = np.clip(0.25 + 0.5 * scene.truth + moving, 0, 1).astype(np.float32)
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


@pytest.mark.parametrize("noise", [0.5, 0.0, pnp_sci.Sensor(0.4, gain=0.01)])
def test_a_noise_that_is_known_stays(textured, good, noise, monkeypatch):
    masks, _, y, _ = textured
    monkeypatch.setattr(module, "noise_left", lambda *_: pytest.fail("the noise was estimated"))
    named, video = (
        pnp_sci.solve(y, masks, init=init, noise=noise, **OPTIONS).settings["noise"] for init in ("good", "adjoint")
    )
    assert named == video


@pytest.mark.parametrize(("prior", "init"), [("flow", "adjoint"), ("tv", "good")])
def test_without_a_decoder_and_a_strong_prior_the_estimate_stays(textured, good, prior, init):
    masks, _, y, _ = textured
    noise = pnp_sci.solve(y, masks, init=init, **OPTIONS | {"prior": prior}).settings["noise"][0]
    assert noise == pytest.approx(pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y), rel=1e-5)


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
@pytest.mark.parametrize("sigma", [0.0, 0.02, 0.1])
def test_with_a_given_sigma_the_estimate_stays(textured, good, algorithm, sigma):
    """Calls that denoise little have fitted the noise by then."""
    masks, _, y, _ = textured
    noise = pnp_sci.solve(y, masks, init="good", sigma=sigma, algorithm=algorithm, **OPTIONS).settings["noise"][0]
    assert noise == pytest.approx(pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y), rel=1e-5)


@pytest.mark.parametrize("options", [{"algorithm": "admm"}, {"backend": "torch"}])
def test_admm_and_torch_lower_it_too(textured, good, options):
    masks, _, y, noise = textured
    used = pnp_sci.solve(y, masks, init="good", **OPTIONS | options).settings["noise"][0]
    assert 0.8 * noise < used < 0.8 * pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)


def test_a_prior_that_leaves_nothing_does_not_lower_it_to_nothing(textured, good):
    """Half of the estimate at least."""
    masks, _, y, _ = textured
    operator = pnp_sci.SensingOperator(masks)
    settings = pnp_sci.solve(y, masks, Keeps(), init="good", scene="full", iterations=4).settings
    assert settings["noise"][0] == pytest.approx(0.5 * pnp_sci.estimate_noise(operator, y), rel=1e-5)


@dataclass(frozen=True)
class Keeps(pnp_sci.Prior):
    """Calls itself strong, and denoises nothing."""

    def traits(self, shape):
        return Traits(strong=True)

    def begin(self, shape, dtype):
        return KeepsSession()


class KeepsSession(Session):
    def __call__(self, v, sigma, out=None):
        return v


def test_measurements_of_a_sequence_share_the_noise(textured, good):
    masks, _, y, _ = textured
    pictures = np.stack([y, y[::-1], y])
    settings = pnp_sci.solve(pictures, masks, init="good", sequence=True, **OPTIONS).settings
    assert len(set(settings["noise"])) == 1


def test_tiles_share_the_noise(textured, monkeypatch):
    masks, _, y, _ = textured
    masks, y = np.tile(masks, (1, 1, 3, 1)), np.tile(y, (3, 1))
    estimate = pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)
    flat = lambda problem, _: np.full(problem.op.shape, 0.5, problem.op.dtype)  # noqa: E731
    monkeypatch.setitem(registry._registered["decoders"], "flat", lambda: flat)

    def settings():
        return pnp_sci.solve(y, masks, Keeps(), init="flat", scene="full", iterations=4).settings

    whole = settings()
    monkeypatch.setattr(tiles, "MOST", 20 * 150**2)
    parts = settings()
    assert whole["noise"] == [pytest.approx(0.5 * estimate, rel=1e-5)]
    assert parts["noise"] == [pytest.approx(estimate, rel=1e-5)]
    assert parts["plan"][0]["rho"] > 3 * whole["plan"][0]["rho"]


def test_before_the_second_call_it_is_the_estimate(textured, good):
    masks, _, y, _ = textured
    noise = pnp_sci.solve(y, masks, init="good", **OPTIONS | {"iterations": 1}).settings["noise"][0]
    assert noise == pytest.approx(pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y), rel=1e-5)


def test_saturated_and_bad_pixels_say_nothing(textured, good):
    masks, _, y, _ = textured
    bad = np.random.default_rng(1).random(y.shape) < 0.1
    wild = np.where(bad, 1e3, np.minimum(y, np.quantile(y, 0.9)))
    sensor = pnp_sci.Sensor(full_scale=float(np.quantile(y, 0.9)))
    lowered = pnp_sci.solve(wild, masks, init="good", noise=sensor, bad=bad, **OPTIONS).settings["noise"][0]
    usual = pnp_sci.solve(y, masks, init="good", **OPTIONS).settings["noise"][0]
    assert lowered == pytest.approx(usual, rel=0.25)
