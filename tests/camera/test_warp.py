"""Masks moved over the picture."""

import numpy as np
import pytest
from moved import moved

from pnp_sci.camera.warp import Transform, known, spread, warped


@pytest.fixture
def planes():
    return np.random.default_rng(0).random((2, 3, 24, 24))


def test_a_quarter_turn_is_that_of_numpy(planes):
    for kind in ("linear", "cubic"):
        assert np.allclose(warped(planes, Transform(rotation=90), kind), np.rot90(planes, axes=(2, 3)), atol=1e-9)


@pytest.mark.parametrize(("kind", "order"), [("linear", 1), ("cubic", 3)])
def test_it_moves_as_scipy_does(planes, kind, order):
    ours = warped(planes, Transform(1.3, -0.4, 2.0, 1.02), kind)
    theirs = moved(planes, (1.3, -0.4), 2.0, 1.02, order)
    assert np.allclose(ours[..., 6:-6, 6:-6], theirs[..., 6:-6, 6:-6], atol=1e-3)


def test_displacement_is_that_of_the_farthest_corner():
    move = Transform(3.0, 4.0)
    assert move.displacement((10, 20)) == pytest.approx(5.0)
    assert move.displacement((10, 20), Transform(3.0, 3.5)) == pytest.approx(0.5)
    assert Transform(scale=1.1).displacement((11, 11)) == pytest.approx(0.5 * 2**0.5)


def test_known_are_the_pixels_that_see_given_elements():
    down = known(Transform(rows=1.5, columns=-1.0), (6, 6))
    expected = np.zeros((6, 6), bool)
    expected[2:, :-1] = True
    assert np.array_equal(down, expected)
    assert known(Transform(), (6, 6)).all()


def test_blur_is_a_gaussian_that_keeps_the_sum(planes):
    point = np.zeros((33, 33))
    point[16, 16] = 1.0
    r = np.arange(33) - 16
    gaussian = np.exp(-(r[:, None] ** 2 + r**2) / (2 * 2.0)) / (2 * np.pi * 2.0)
    assert np.allclose(spread(point, 2.0), gaussian, atol=1e-4)
    assert spread(planes, 0.5).sum() == pytest.approx(planes.sum())
    numerical = (spread(planes, 0.5 + 1e-5) - spread(planes, 0.5 - 1e-5)) / 2e-5
    assert np.allclose(spread(planes, 0.5, derivative=True), numerical, atol=1e-6)
