import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pnp_sci
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.masks import condition, moving_masks, random_masks

steps = st.tuples(st.integers(-3, 3), st.integers(-3, 3))


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("density", [0.0, 0.3, 1.0])
def test_density_shape_and_seed(make, density):
    masks = make((2, 4, 60, 50), density, seed=3)
    assert masks.dtype == bool
    assert masks.shape == (2, 4, 60, 50)
    assert masks.mean() == pytest.approx(density, abs=0.03)
    assert np.array_equal(masks, make((2, 4, 60, 50), density, seed=3))
    if density == 0.3:
        assert not np.array_equal(masks, make((2, 4, 60, 50), density, seed=4))


@settings(max_examples=50, deadline=None)
@given(step=steps, view_shift=steps)
def test_moving_masks_are_one_pattern_moved(step, view_shift):
    """Mask (v, b) is mask (0, 0) moved by b * step + v * view_shift, wherever both see the pattern."""
    masks = moving_masks((3, 3, 24, 22), step=step, view_shift=view_shift)
    wide = np.full((72, 66), -1)
    wide[24:48, 22:44] = masks[0, 0]
    for v, b in np.ndindex(3, 3):
        down, right = np.multiply(b, step) + np.multiply(v, view_shift)
        expected = wide[24 - down : 48 - down, 22 - right : 44 - right]
        seen = expected >= 0
        assert seen.any()
        assert np.array_equal(masks[v, b][seen], expected[seen] == 1)


def test_moving_masks_do_not_wrap():
    masks = moving_masks((1, 2, 64, 64), step=(1, 0))
    assert not np.array_equal(masks[0, 1, 0], masks[0, 0, -1])


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize(("shape", "density"), [((2, 3, 4), 0.5), ((2, 0, 4, 4), 0.5), ((1, 1, 4, 4), 1.5)])
def test_impossible_masks_are_refused(make, shape, density):
    with pytest.raises(InputError, match="was expected"):
        make(shape, density)


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"shape": (1, 2, 8.0, 8)}, "shape is .*whole numbers"),
        ({"shape": 8}, "shape is 8"),
        ({"seed": "x"}, "seed is 'x'"),
        ({"seed": -1}, "seed is -1"),
        ({"density": "half"}, "density is 'half'"),
    ],
)
def test_arguments_that_cannot_be_used(make, wrong, message):
    with pytest.raises(InputError, match=message):
        make(**{"shape": (1, 2, 8, 8), **wrong})


@pytest.mark.parametrize("wrong", [{"step": 1}, {"step": (0.5, 1)}, {"view_shift": (1, 2, 3)}])
def test_shifts_are_two_whole_numbers(wrong):
    with pytest.raises(InputError, match="two whole numbers"):
        moving_masks((1, 2, 8, 8), **wrong)


def test_condition_of_good_masks():
    report = condition(moving_masks((2, 10, 128, 128)))
    assert report.separable
    assert report.view_correlation < 0.05
    assert report.frame_correlation < 0.05
    assert (report.dtype, report.levels, report.minimum, report.maximum) == ("bool", 2, 0, 1)
    assert "2 views x 10 frames of 128 x 128" in str(report)


def test_condition_counts_closed_pixels():
    masks = np.ones((2, 3, 10, 10))
    masks[0, :, :2] = 0
    masks[1, :, :1] = 0
    masks[1, 0, 5] = 0
    report = condition(masks)
    assert report.closed == pytest.approx((0.2, 0.1))
    assert report.closed_in_all == pytest.approx(0.1)
    assert (report.gram_min, report.gram_max) == (0, 6)
    assert any("nothing is measured" in sentence for sentence in report.warnings)


@pytest.mark.parametrize("second", [lambda m: m, lambda m: 3 * m, lambda m: 0 * m], ids=["same", "scaled", "closed"])
def test_inseparable_views(second):
    first = random_masks((1, 5, 40, 40)).astype(float)
    report = condition(np.concatenate((first, second(first))))
    assert not report.separable
    assert any("cannot be told apart" in sentence for sentence in report.warnings)


def test_a_view_that_is_the_sum_of_two_others_is_inseparable():
    masks = random_masks((2, 5, 40, 40)).astype(float)
    report = condition(np.concatenate((masks, masks.sum(0, keepdims=True))))
    assert report.view_correlation < 0.8
    assert not report.separable


def test_correlations_do_not_depend_on_scale_and_offset():
    masks = random_masks((2, 4, 40, 40)).astype(float)
    same = np.stack((masks[0], 5 + 2 * masks[0]))
    assert condition(same).view_correlation == pytest.approx(1)
    a, b = condition(masks), condition(1e30 * masks)
    assert a.view_correlation == pytest.approx(b.view_correlation)
    assert a.frame_correlation == pytest.approx(b.frame_correlation)


def test_equal_frames_are_noticed():
    masks = random_masks((1, 3, 40, 40))
    masks[0, 2] = masks[0, 0]
    report = condition(masks)
    assert report.frame_correlation == pytest.approx(1)
    assert any("motion" in sentence for sentence in report.warnings)


def test_noise_of_a_calibration_is_no_negative_mask():
    """Bug: check_fit found no stuck lines, decoders refused the masks, and a warning came."""
    rng, scene = np.random.default_rng(0), pnp_sci.datasets.embedded_scene(64)
    masks = scene.masks + 0.005 * rng.standard_normal(scene.masks.shape)
    assert condition(masks).warnings == condition(scene.masks).warnings
    stuck = scene.y.copy()
    stuck[:, 20] = 0.8 * stuck.max()
    assert [f.kind for f in pnp_sci.check_fit(stuck, masks).findings] == ["stuck"]
    decoded = [pnp_sci.decode(scene.y, planes, "ofanet-fast").x for planes in (masks, np.maximum(masks, 0))]
    np.testing.assert_allclose(*decoded, atol=0.05)


def test_uniform_and_negative_masks_are_noticed():
    assert any("nothing is coded" in sentence for sentence in condition(np.ones((1, 2, 4, 4))).warnings)
    assert any("negative" in sentence for sentence in condition(random_masks((1, 2, 9, 9)) - 0.5).warnings)


def test_condition_refuses_what_are_no_masks():
    with pytest.raises(InputError, match="masks has shape"):
        condition(np.ones((4, 4)))
    with pytest.raises(InputTypeError, match="real numbers"):
        condition(np.ones((1, 2, 4, 4), complex))
