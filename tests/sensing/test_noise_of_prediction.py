"""The noise in the blocks of a residual in which it is small."""

import numpy as np
import pytest

from pnp_sci.sensing.noise import noise_of_prediction


def noise_of(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def some(shape, part):
    return np.random.default_rng(5).random(shape) < part


@pytest.mark.parametrize("shape", [(64, 64), (128, 96), (67, 75), (3, 64, 64)])
@pytest.mark.parametrize("sigma", [1e-6, 0.3, 1e4])
@pytest.mark.parametrize("part", [1.0, 0.05])
def test_of_noise_alone_it_is_the_standard_deviation(shape, sigma, part):
    found = [noise_of_prediction(sigma * noise_of(shape, seed), some(shape, part)) for seed in range(8)]
    assert np.mean(found) == pytest.approx(sigma, rel=0.1)
    assert np.max(found) < 1.4 * sigma
    assert np.min(found) > 0.7 * sigma


def test_a_fifth_of_the_picture_is_enough():
    residual = noise_of((128, 128))
    residual[:, 32:] *= 50
    assert noise_of_prediction(residual, some(residual.shape, 0.05)) == pytest.approx(1, rel=0.5)


def test_pixels_that_were_seen_do_not_count():
    residual, unseen = noise_of((128, 128)), some((128, 128), 0.2)
    assert noise_of_prediction(np.where(unseen, residual, 0), unseen) == noise_of_prediction(residual, unseen)


def test_of_too_few_blocks_nothing_can_be_said():
    assert noise_of_prediction(noise_of((63, 64)), np.ones((63, 64), bool)) == np.inf
    assert noise_of_prediction(noise_of((64, 64)), np.zeros((64, 64), bool)) == np.inf
