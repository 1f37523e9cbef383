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


def test_the_closed_pixels_of_sparse_masks_tell_the_noise(truth):
    masks = pnp_sci.random_masks((1, 8, SIZE, SIZE), 0.05, seed=0)
    y = pnp_sci.simulate(truth[:1, :8], masks)
    sigma = 0.02 * float(y.max())
    assert sigma < estimate(noisy(y), masks) < 1.3 * sigma


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
