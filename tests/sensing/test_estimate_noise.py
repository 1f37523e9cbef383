"""The noise of a measurement, from its flattest blocks: unlit regions and frames that differ in brightness."""

import numpy as np
import pytest

import pnp_sci

SIZE = 128
CIRCLE = sum((np.indices((SIZE, SIZE)) - SIZE / 2) ** 2) < (0.45 * SIZE) ** 2


@pytest.fixture(scope="module")
def truth():
    return pnp_sci.datasets.embedded_scene(SIZE).truth.astype(np.float32)


def estimate(y, masks):
    return pnp_sci.estimate_noise(pnp_sci.SensingOperator(masks), y)


def noisy(y, part=0.02):
    return y + part * y.max() * np.random.default_rng(0).standard_normal(y.shape)


@pytest.mark.parametrize("leak", [0, 0.002])
def test_beside_a_stop_there_is_nothing_to_learn(truth, leak):
    """Neither where y is 0 nor where a little light comes through."""
    masks = pnp_sci.random_masks(truth.shape, seed=0).astype(np.float32)
    stopped = masks * np.where(CIRCLE, 1, leak).astype(np.float32)
    y = noisy(pnp_sci.simulate(truth, masks))
    assert estimate(np.where(CIRCLE, y, 0), stopped) == pytest.approx(estimate(y, masks), rel=0.15)


@pytest.mark.parametrize("width", [1, 2, 3, 4, 5, 6])
def test_a_dark_border_of_any_width_does_not_count(truth, width):
    masks = pnp_sci.random_masks(truth.shape, seed=0)
    inside = np.pad(np.ones((SIZE - width, SIZE), bool), ((0, width), (0, 0)))
    y = noisy(pnp_sci.simulate(truth, masks))
    assert estimate(y * inside, masks * inside) == pytest.approx(estimate(y, masks), rel=0.1)


def test_a_dark_corner_does_not_hide_the_other_blocks():
    """Of ten views, whose 40 coefficients leave 24 of the 64 pixels of a block."""
    masks = pnp_sci.random_masks((10, 2, SIZE, SIZE), seed=0)
    y = noisy(pnp_sci.simulate(np.full(masks.shape, 0.5), masks))
    masks[..., :5, :5] = 0
    assert estimate(y, masks) == pytest.approx(0.02 * y.max(), rel=0.2)


def test_saturated_pixels_do_not_tell_the_light_of_frames(truth):
    masks = pnp_sci.moving_masks(truth.shape, seed=0)
    y = pnp_sci.simulate(truth * np.where(np.arange(10) % 2, 0.3, 1)[:, None, None], masks)
    saturated, op = y >= np.quantile(y, 0.9), pnp_sci.SensingOperator(masks)
    found = [pnp_sci.estimate_noise(op, np.where(saturated, value, y), saturated) for value in (0, 100)]
    assert found[0] == found[1] > 0


def test_the_closed_pixels_of_sparse_masks_tell_the_noise(truth):
    masks = pnp_sci.random_masks((1, 8, SIZE, SIZE), 0.05, seed=0)
    y = pnp_sci.simulate(truth[:1, :8], masks)
    sigma = 0.02 * float(y.max())
    assert 0.95 * sigma < estimate(noisy(y), masks) < 1.3 * sigma


@pytest.mark.parametrize("noise", [0, 0.01])
@pytest.mark.parametrize(
    "light", [np.where(np.arange(10) % 2, 0.3, 1), 0.7 ** np.arange(10)], ids=["strobed", "decaying"]
)
def test_frames_may_differ_in_brightness(truth, light, noise):
    masks = pnp_sci.moving_masks(truth.shape, seed=0)
    steady, flickering = (
        noisy(pnp_sci.simulate(truth * a, masks), noise) for a in (light.mean(), light[:, None, None])
    )
    assert estimate(flickering, masks) < 2 * estimate(steady, masks)
    assert estimate(flickering, masks) > noise * flickering.max() * 0.95
