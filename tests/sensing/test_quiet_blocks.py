"""The noise in the quietest blocks of a residual."""

import numpy as np
import pytest

from pnp_sci.sensing.noise import noise_left


def noise_of(shape, seed=0):
    return np.random.default_rng(seed).standard_normal(shape)


def of_all(residual):
    return noise_left(residual, np.ones(residual.shape, bool))


@pytest.mark.parametrize("shape", [(64, 64), (128, 96), (67, 75)])
@pytest.mark.parametrize("sigma", [1e-6, 0.3, 1e4])
def test_of_noise_alone_it_is_the_standard_deviation(shape, sigma):
    assert of_all(sigma * noise_of(shape)) == pytest.approx(sigma, rel=0.15)


def test_a_few_quiet_blocks_are_enough():
    residual = noise_of((128, 128))
    residual[:, 32:] *= 50
    assert of_all(residual) == pytest.approx(1, rel=0.3)


def test_pixels_of_which_nothing_is_known_do_not_count():
    residual = noise_of((128, 128))
    known = noise_of((128, 128), 1) < 0.4
    residual[~known] = 1e9
    assert noise_left(residual, known) == pytest.approx(1, rel=0.15)
    assert noise_left(np.where(known, residual, 0), known) == noise_left(residual, known)


def test_of_too_few_blocks_nothing_can_be_said():
    assert of_all(noise_of((31, 31))) == np.inf
    assert noise_left(noise_of((64, 64)), np.zeros((64, 64), bool)) == np.inf
