"""The noise of a scene that stands still is what predicts pixels of y best: texture does not count as noise."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.pipeline import noise_of_still as module
from pnp_sci.pipeline import tiles
from pnp_sci.pipeline.noise_of_still import gain
from pnp_sci.sensing.scene_model import SceneModel

SIDE = 96
STILL = SceneModel((True, True), True)


@pytest.fixture(scope="module")
def textured():
    """Two still scenes with a weave all over, seen through six frames: masks and truth."""
    rows, columns = np.indices((SIDE, SIDE))
    weave = np.stack([np.sin(rows * 0.9) * np.sin(columns * 0.7), np.sin(rows * 0.6 + columns * 0.8)])
    truth = np.repeat((0.5 + 0.4 * weave)[:, None], 6, 1).astype(np.float32)
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    return masks, truth


def measured(textured, noise):
    masks, truth = textured
    return pnp_sci.simulate(truth, masks, noise, seed=2)


def estimate(masks, y):
    return pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)


def mean_psnr(x, truth):
    return float(np.mean(pnp_sci.psnr(x, truth)))


@pytest.mark.parametrize("prior", ["tv", "ffdnet"])
@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_texture_is_not_taken_for_noise(textured, prior, noise):
    masks, truth = textured
    y = measured(textured, noise)
    result = pnp_sci.solve(y, masks, prior, scene=STILL)
    before = pnp_sci.solve(y, masks, prior, scene=STILL, noise=estimate(masks, y))
    assert result.settings["noise"][0] < 0.5 * estimate(masks, y)
    assert mean_psnr(result.x, truth) > mean_psnr(before.x, truth) + 1


@pytest.mark.parametrize("prior", ["tv", "ffdnet"])
@pytest.mark.parametrize("noise", [0.01, 0.03])
def test_noise_is_not_taken_for_texture(prior, noise):
    """Scenes with flat parts, so that the estimate is right."""
    scene = pnp_sci.datasets.embedded_scene(128)
    truth = np.repeat(scene.truth[:, :1], 10, 1)
    y = pnp_sci.simulate(truth, scene.masks, noise, seed=3)
    settings = pnp_sci.solve(y, scene.masks, prior, scene=STILL, init="adjoint").settings
    assert settings["noise"][0] == pytest.approx(estimate(scene.masks, y), rel=1e-5)
    assert settings["noise"][0] == pytest.approx(noise * pnp_sci.simulate(truth, scene.masks).max(), rel=0.3)


@pytest.mark.parametrize(
    "options",
    [{"noise": 0.7}, {"noise": pnp_sci.Sensor(0.5, gain=0.01)}, {"scene": "full"}],
)
def test_what_is_given_stays(textured, options, monkeypatch):
    masks, _ = textured
    monkeypatch.setattr(module, "held_back", lambda *_: pytest.fail("the noise was judged"))
    pnp_sci.solve(measured(textured, 0.0), masks, **{"scene": STILL, "iterations": 3} | options)


@pytest.mark.parametrize("options", [{"algorithm": "admm"}, {"sigma": 0.02}, {"iterations": 2}])
def test_whatever_solves_is_told_the_same(textured, options):
    masks, _ = textured
    y = measured(textured, 0.0)
    usual, other = (pnp_sci.solve(y, masks, scene=STILL, **o).settings["noise"] for o in ({}, options))
    assert usual == other


def test_a_prior_that_does_not_predict_better_is_not_told_less(textured):
    """Though total variation does."""
    masks, _ = textured
    y = measured(textured, 0.0)
    settings = pnp_sci.solve(y, masks, lambda v, sigma: np.full_like(v, 0.5), scene=STILL).settings
    assert settings["noise"][0] == pytest.approx(estimate(masks, y), rel=1e-5)


def test_tiles_and_sequences_are_told_one_noise(textured, monkeypatch):
    masks, _ = textured
    y = measured(textured, 0.0)
    whole = pnp_sci.solve(y, masks, scene=STILL)
    assert whole.settings["noise"][0] < 0.5 * estimate(masks, y)
    together = pnp_sci.solve(np.stack([y] * 3), masks, scene=STILL, sequence=True).settings
    assert together["noise"] == pytest.approx(whole.settings["noise"] * 3, rel=1e-5)
    others = np.stack([y, measured(textured, 0.02), y, y, y])  # the one in the middle stands for all windows
    windows = pnp_sci.solve(others, masks, scene=STILL, sequence=3).settings
    assert len(set(windows["noise"])) == 1
    large, tall = np.tile(y, (3, 1)), np.tile(masks, (1, 1, 3, 1))
    one = pnp_sci.solve(large, tall, scene=STILL)
    assert one.settings["noise"][0] < 0.5 * estimate(tall, large)
    monkeypatch.setattr(tiles, "MOST", 12 * 160**2)
    parts = pnp_sci.solve(large, tall, scene=STILL)
    assert parts.settings["noise"] == one.settings["noise"]
    assert np.abs(parts.x - one.x).max() > 0, "there were tiles"


def test_uncertainty_tells_the_errors_of_a_textured_scene(textured):
    """Its second estimate, from fewer pixels, is told as little noise."""
    masks, truth = textured
    y = measured(textured, 0.0)
    result = pnp_sci.solve(y, masks, scene=STILL, uncertainty=True)
    assert np.sqrt(np.mean((result.x - truth) ** 2)) == pytest.approx(np.sqrt(np.mean(result.uncertainty**2)), rel=0.5)


def test_mosaics_are_judged_as_well(textured, monkeypatch):
    truth = textured[1].repeat(2, 2).repeat(2, 3)
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    y = pnp_sci.simulate(truth, masks)
    lowered = pnp_sci.solve(y, masks, scene=STILL, mosaic="RGGB").settings["noise"][0]
    monkeypatch.setattr("pnp_sci.pipeline.measurement.noise_of_still", lambda problems, *_: problems)
    assert lowered < 0.6 * pnp_sci.solve(y, masks, scene=STILL, mosaic="RGGB").settings["noise"][0]


def test_without_time_the_estimate_stays(textured, monkeypatch):
    masks, _ = textured
    y = measured(textured, 0.0)
    monkeypatch.setattr("pnp_sci.pipeline.measurement.judged_until", lambda _: 0.0)
    settings = pnp_sci.solve(y, masks, scene=STILL).settings
    assert settings["noise"][0] == pytest.approx(estimate(masks, y), rel=1e-5)


def test_pictures_with_few_pixels_have_no_evidence(textured):
    masks, _ = textured
    y, masks = (a[..., :32, :32].copy() for a in (measured(textured, 0.0), masks))
    assert estimate(masks, y) > 0
    settings = pnp_sci.solve(y, masks, scene=STILL).settings
    assert settings["noise"][0] == pytest.approx(estimate(masks, y), rel=1e-4)


@pytest.mark.parametrize("frames", [1, 6])
def test_saturated_and_bad_pixels_say_nothing(textured, frames):
    masks, truth = textured
    masks, truth = masks[:, :frames].astype("f8"), truth[:, :frames].astype("f8")
    masks[:, 0] = np.random.default_rng(4).uniform(0.1, 1, masks[:, 0].shape)
    y = pnp_sci.simulate(truth, masks)
    scene = STILL if frames > 1 else "full"
    usual = pnp_sci.solve(y, masks, scene=scene).settings["noise"][0]
    bad = np.random.default_rng(1).random(y.shape) < 0.05
    top = float(np.quantile(y, 0.97))
    wild = np.where(bad, 1e3, np.minimum(y, top))
    used = pnp_sci.solve(wild, masks, scene=scene, noise=pnp_sci.Sensor(full_scale=top), bad=bad).settings["noise"][0]
    assert usual < 0.3 * estimate(masks, y)
    assert used < 0.3 * estimate(masks, y)


def test_halvings_are_few(textured, monkeypatch):
    masks, _ = textured
    monkeypatch.setattr(module, "gain", lambda *_: np.inf)
    y = measured(textured, 0.0)
    assert pnp_sci.solve(y, masks, scene=STILL).settings["noise"][0] == pytest.approx(estimate(masks, y) / 64)


def test_chance_does_not_count():
    random = np.random.default_rng(0)
    some, others = random.chisquare(6, (2, 1000))
    assert abs(gain(some, others)) < 3
    assert gain(0.5 * some, others) > 3
    assert gain(others, 0.5 * some) < -3
    assert gain(np.zeros(100), np.zeros(100)) == 0
    assert gain(0.5 * some[:15], others[:15]) == 0
    large = random.chisquare(6, 1000)
    large[0] = 1e9  # one block alone
    assert gain(some, large) < 3
