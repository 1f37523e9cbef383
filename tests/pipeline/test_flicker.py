"""Light that flickers: what compares frames, priors and decoders, takes that into account."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.errors import InputError

LIGHT = np.where(np.arange(10) % 2, 0.3, 1)
STROBED = {"noise": 0, "iterations": 15}


@pytest.fixture(scope="module")
def scene():
    return pnp_sci.datasets.embedded_scene(96)


@pytest.fixture(scope="module")
def strobed(scene):
    truth = (scene.truth * LIGHT[:, None, None]).astype(np.float32)
    return truth, pnp_sci.simulate(truth, scene.masks)


def score(x, truth):
    return float(np.mean(pnp_sci.psnr(x, truth)))


def is_lit_by(light, found):
    """The scene itself changes by about 0.03 of its mean."""
    return np.sqrt(np.mean((np.array(found["light"]) - light / light.mean()) ** 2)) < 0.1


def test_the_video_is_nearly_as_good_as_in_steady_light(scene, strobed):
    truth, y = strobed
    with_flow = pnp_sci.solve(y, scene.masks, "flow", reference=truth, peak=1, **STROBED)
    steady = pnp_sci.solve(scene.y, scene.masks, "flow", **STROBED)
    # a scene with 0.65 of the light has errors that are 3.7 dB smaller
    assert score(with_flow.x, truth) > score(steady.x, scene.truth) + 2
    assert with_flow.history[-1].psnr == pytest.approx(score(with_flow.x, truth), abs=1e-3)
    assert is_lit_by(LIGHT, with_flow.scene)
    assert "light: of view 2 frames are lit by 0." in str(with_flow)
    assert steady.scene["light"] is None
    assert "light:" not in str(steady)


@pytest.mark.parametrize("model", ["ofanet-fast", "ofanet", "unet"])
def test_decoders_see_steady_light(scene, strobed, model):
    truth, y = strobed
    flickering, steady = pnp_sci.decode(y, scene.masks, model), pnp_sci.decode(scene.y, scene.masks, model)
    assert score(flickering.x, truth) > score(steady.x, scene.truth)
    assert flickering.scene["light"] is not None


def test_plain_priors_take_frames_as_they_are(scene, strobed):
    """But a decoder that they start from does not."""
    _, y = strobed
    problems, seen = [], []

    def decoder(problem, model):
        problems.append(problem)
        return np.ones(problem.op.shape)

    def prior(v, sigma):
        seen.append(v.copy())
        return v

    result = pnp_sci.solve(y, scene.masks, prior, init=decoder, iterations=1, noise=0)
    assert is_lit_by(LIGHT, result.scene)
    assert np.ptp(problems[0].op.masks.max((0, 2, 3))) > 0.5
    assert seen[0][:, 1::2].mean() < 0.6 * seen[0][:, ::2].mean()


def test_a_video_as_first_estimate_is_in_the_units_of_the_result(scene, strobed):
    truth, y = strobed
    result = pnp_sci.solve(y, scene.masks, "flow", init=truth, iterations=1, noise=0)
    assert score(result.x, truth) > 35
    with pytest.raises(InputError, match="init has shape"):
        pnp_sci.solve(y, scene.masks, "flow", init=truth[0, 0])


def test_a_still_scene_is_seen_to_be_still(scene, strobed):
    still = np.repeat(scene.truth[:, :1], 10, 1) * LIGHT[:, None, None]
    result = pnp_sci.solve(pnp_sci.simulate(still, scene.masks), scene.masks, "flow", iterations=5)
    assert result.scene["still"] is True
    ratio = result.x[0, 1].mean() / result.x[0, 0].mean()
    assert ratio == pytest.approx(0.3, abs=0.03)


@pytest.mark.parametrize("scale", [1e-300, 1, 1e300])
def test_frames_without_light_are_dark(scene, scale):
    """In any units."""
    truth = scene.truth * (np.arange(10) % 2)[:, None, None]
    y = pnp_sci.simulate(truth, scene.masks).astype(float) * scale
    result = pnp_sci.solve(y, scene.masks, "flow", scene="full", **STROBED)
    assert result.x[:, ::2].mean() < 0.05 * result.x[:, 1::2].mean()


def test_predicted_errors_are_in_the_units_of_the_result(scene, strobed):
    truth, y = strobed
    result = pnp_sci.solve(y, scene.masks, "flow", uncertainty=True, **STROBED)
    dim, bright = (np.nanmean(result.uncertainty[:, own]) for own in (slice(1, None, 2), slice(0, None, 2)))
    assert dim < 0.6 * bright
    ratio = np.sqrt(np.mean((result.x - truth) ** 2) / np.mean(result.uncertainty**2))
    assert 0.4 < ratio < 2.5


@pytest.mark.parametrize("sequence", [False, True])
def test_each_measurement_has_its_own_light(scene, strobed, sequence):
    truth, y = strobed
    other = (scene.truth * LIGHT[::-1, None, None]).astype(np.float32)
    ys = np.stack([y, pnp_sci.simulate(other, scene.masks), scene.y])
    result = pnp_sci.solve(ys, scene.masks, "flow", sequence=sequence, scene="full", **STROBED)
    first, second, third = result.scenes
    assert is_lit_by(LIGHT, first)
    assert is_lit_by(LIGHT[::-1], second)
    assert third["light"] is None
    for x, expected in zip(result.x, (truth, other, scene.truth)):
        assert score(x, expected) > 23


def test_of_mosaics_too(scene):
    truth = np.stack([scene.truth] * 3, -1) * LIGHT[:, None, None, None]
    y = pnp_sci.simulate(truth, scene.masks, mosaic="RGGB")
    result = pnp_sci.solve(y, scene.masks, "flow", mosaic="RGGB", reference=truth, peak=1, **STROBED)
    assert is_lit_by(LIGHT, result.scene)
    assert result.history[-1].psnr == pytest.approx(score(result.x, truth), abs=1e-2)


def test_a_callback_that_stops_at_once_leaves_the_level(scene, strobed):
    _, y = strobed
    result = pnp_sci.solve(np.stack([y, y]), scene.masks, "flow", callback=lambda state: True)
    assert result.x[1].mean() == pytest.approx(y.mean() / scene.masks.sum((0, 1)).mean(), rel=0.1)
