"""A measurement made ready for the solver: its unit, and the start called "adjoint"."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SensingOperator, Sensor
from pnp_sci.sensing.problem import Problem, check_measurement, check_operator, level, pose


def test_the_first_estimate_reaches_pixels_that_no_mask_lets_light_to():
    masks = pnp_sci.random_masks((2, 4, 48, 48), 0.05)
    assert (masks.sum((0, 1)) == 0).mean() > 0.5
    op = SensingOperator(masks)
    estimate = level(op, op.forward(np.full(op.shape, 0.5, np.float32)))
    assert 0.35 < estimate.min() <= estimate.max() < 0.55
    assert not level(SensingOperator(np.zeros((1, 2, 5, 5))), np.ones((5, 5), np.float32)).any()
    lit = masks.any((0, 1))
    y = np.where(np.arange(48) < 24, op.forward(np.full(op.shape, 0.5, np.float32)), 0)
    assert not level(op, y)[:, :, :, 24:][..., lit[:, 24:]].any()  # what is measured as 0 is not filled


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("transmission", [1.0, 0.01, 255.0])
def test_the_video_spans_the_unit(scale, transmission):
    """Whatever the units of y and of the masks: in those of the problem the brightest value is about 1."""
    scene = pnp_sci.datasets.embedded_scene(48)
    y = check_measurement(scale * transmission * scene.y.astype(np.float64))
    op, largest = check_operator(transmission * scene.masks.astype(np.float64), y)
    problem = pose(op, largest, y[0], Sensor(0.01 * scale * transmission))
    assert 0.7 < scale * scene.truth.max() / problem.unit < 1.5
    np.testing.assert_allclose(problem.y * problem.unit * largest, y[0], rtol=1e-6)
    assert problem.typical_noise * problem.unit * largest == pytest.approx(0.01 * scale * transmission)


def test_saturated_pixels_do_not_count_in_the_typical_noise():
    op, noise = SensingOperator(np.ones((1, 1, 2, 2))), np.array([[1.0, 1.0], [1.0, 100.0]])
    saturated = np.array([[False, False], [False, True]])
    assert Problem(op, np.ones((2, 2)), 1.0, noise, saturated).typical_noise == pytest.approx(1.0)
    assert Problem(op, np.ones((2, 2)), 1.0, noise).typical_noise > 10
    assert Problem(op, np.ones((2, 2)), 1.0, noise, ~np.zeros((2, 2), bool)).typical_noise > 10


@pytest.mark.parametrize("which", ["saturated", "bad"])
def test_saturated_and_bad_pixels_do_not_tell_the_light_of_frames(monkeypatch, which):
    told = []
    monkeypatch.setattr("pnp_sci.sensing.problem.light_of_frames", lambda op, y, used: told.append(used) or np.ones(1))
    op, y = SensingOperator(np.ones((1, 1, 32, 32))), np.ones((32, 32))
    some = np.arange(1024).reshape(32, 32) % 7 == 0
    if which == "bad":
        pose(op, 1.0, y, Sensor(0.1), some)
    else:
        pose(op, 1.0, y + some, Sensor(0.1, full_scale=2.0))
    assert np.array_equal(told[0], ~some)
