"""Masks that are off are found from the measurement alone; masks that fit are left alone."""

import json

import numpy as np
import pytest
from moved import moved, seen_through
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import io
from pnp_sci.camera.straight_line import straight_line
from pnp_sci.errors import InputError, InputTypeError

SIZE = 96


@pytest.fixture(scope="module")
def scene():
    return pnp_sci.datasets.embedded_scene(SIZE)


def apart(transform, shift, degrees, scale):
    """The farthest way between where a transform and the true motion lead a corner of the picture."""
    return transform.displacement((SIZE, SIZE), pnp_sci.Transform(*shift, degrees, scale))


@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.parametrize(("shift", "degrees", "scale"), [((0.5, 0.3), 0.1, 1.0), ((-2.6, 3.0), 0.5, 1.005)])
def test_shift_rotation_and_scale_are_found(scene, shift, degrees, scale, order):
    y = seen_through(moved(scene.masks, shift, degrees, scale, order), scene.truth)
    black = 0.2 * y.max()
    found = pnp_sci.register(1.02 * y + black, scene.masks)
    assert found.trusted
    assert found.interpolation == {1: "linear", 3: "cubic"}[order]
    assert all(apart(transform, shift, degrees, scale) < 0.05 for transform in found.transforms)
    assert found.black_level == pytest.approx(black, abs=0.005 * y.max())
    assert found.after > 0.75 > 0.5 > found.before


@pytest.mark.parametrize("noise", [0.0, 0.03, 0.1])
def test_masks_that_fit_stay_bit_for_bit(scene, noise):
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=noise, seed=1)
    found = pnp_sci.register(y, scene.masks)
    assert found.trusted
    assert found.identity
    assert np.array_equal(found.masks, scene.masks)
    assert found.masks.dtype == np.uint8  # as it was given: not interpolated
    assert np.array_equal(found.correct(y), y)


@pytest.mark.parametrize("brightness", [1.0, 0.3])
def test_masks_that_complement_each_other_stay_and_have_no_black_level(scene, brightness):
    """Bug: the light that both views share, which no detail tells, was the camera's black level."""
    masks = np.stack([scene.masks[0], 1 - scene.masks[0]])
    y = pnp_sci.simulate(scene.truth * np.array([1, brightness])[:, None, None, None], masks, noise=0.01, seed=1)
    found = pnp_sci.register(y, masks)
    assert found.trusted
    assert found.identity
    assert found.black_level == 0
    for shift in ((1, 1), (-1, 2), (4, 0)):
        moved_back = pnp_sci.register(y, np.roll(masks, shift, (2, 3)))
        assert moved_back.trusted
        assert [(-t.rows, -t.columns) for t in moved_back.transforms] == [shift] * 2
    first = pnp_sci.moving_masks(scene.masks.shape, seed=50)[0]
    assert not pnp_sci.register(y, np.stack([first, 1 - first])).trusted


def test_a_shift_by_whole_pixels_interpolates_nothing(scene):
    found = pnp_sci.register(scene.y, np.roll(scene.masks, (-1, 2), (2, 3)))
    assert [(t.rows, t.columns, t.rotation, t.scale, t.blur) for t in found.transforms] == [(1, -2, 0, 1, 0)] * 2
    inside = found.known
    assert np.array_equal(found.masks[..., inside], scene.masks[..., inside])
    assert not found.masks[..., ~inside].any()
    assert not found.correct(scene.y)[~inside].any()


def test_views_may_move_apart(scene):
    moves = ((0.5, 0.3), (-1.2, 0.8))
    masks = np.stack([moved(view, move, order=3) for view, move in zip(scene.masks, moves)])
    y = seen_through(masks, scene.truth)
    found = pnp_sci.register(y, scene.masks)
    assert all(apart(transform, move, 0, 1) < 0.05 for transform, move in zip(found.transforms, moves))
    assert len(set(pnp_sci.register(y, scene.masks, each_view=False).transforms)) == 1


def test_one_view_may_move_though_texture_hides_more_than_it_explains():
    """Bug: both views had a transform between their own."""
    texture = gaussian_filter(np.random.default_rng(0).random((2, 8, SIZE, SIZE)), (0, 4, 1.2, 1.2))
    truth = np.clip(0.4 + 0.3 * (texture - 0.5) / texture.std(), 0, 1)
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    other = moved(masks, (0.34, 0.5))
    found = pnp_sci.register(seen_through(np.stack([other[0], masks[1]]), truth), masks).transforms
    assert apart(found[0], (0.34, 0.5), 0, 1) < 0.15 > apart(found[1], (0, 0), 0, 1)
    for same in (masks, other):
        assert len(set(pnp_sci.register(seen_through(same, truth), masks).transforms)) == 1


def test_a_dim_view_moves_with_the_first_of_those_that_moved_apart():
    texture = gaussian_filter(np.random.default_rng(0).random((3, 8, SIZE, SIZE)), (0, 4, 1.2, 1.2))
    truth = np.clip(0.4 + 0.1 * (texture - 0.5) / texture.std(), 0, 1) * np.array([1, 1, 0.02])[:, None, None, None]
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    one, other = moved(masks, (0.3, 0.5)), moved(masks, (1.6, -0.8))
    first, second, dim = pnp_sci.register(seen_through(np.stack([one[0], other[1], one[2]]), truth), masks).transforms
    assert apart(first, (0.3, 0.5), 0, 1) < 0.1 > apart(second, (1.6, -0.8), 0, 1)
    assert dim == first


def test_a_dark_view_moves_with_the_other(scene):
    y = seen_through(moved(scene.masks[:1], (0.5, 0.3)), scene.truth[:1])
    first, second = pnp_sci.register(y, scene.masks).transforms
    assert first == second
    assert apart(first, (0.5, 0.3), 0, 1) < 0.05


def test_blur_is_found(scene):
    from scipy.ndimage import gaussian_filter

    masks = gaussian_filter(moved(scene.masks, (0.5, 0.3)), (0, 0, 0.8, 0.8))
    found = pnp_sci.register(seen_through(masks, scene.truth), scene.masks)
    assert found.transforms[0].blur == pytest.approx(0.64, abs=0.1)
    assert apart(found.transforms[0], (0.5, 0.3), 0, 1) < 0.1
    assert found.black_level == 0


@pytest.mark.parametrize(
    "wrong",
    [
        lambda masks: masks[:, :, ::-1],
        lambda masks: masks.swapaxes(2, 3),
        lambda masks: ~masks,
        lambda masks: pnp_sci.random_masks(masks.shape, seed=9),
        np.zeros_like,
    ],
    ids=["flipped", "transposed", "inverted", "of another setup", "closed"],
)
def test_masks_that_are_wrong_otherwise_are_left_alone(scene, wrong, caplog):
    masks = wrong(scene.masks)
    found = pnp_sci.register(scene.y, masks)
    assert not found.trusted
    assert found.identity
    assert found.black_level == 0
    assert np.array_equal(found.masks, masks)
    assert "no shift, rotation or scale makes the masks fit" in caplog.text
    assert "no shift, rotation or scale makes the masks fit" in repr(found)


@pytest.mark.parametrize("y", [np.zeros((64, 64)), np.ones((64, 64)), np.random.default_rng(0).random((64, 64))])
def test_nothing_is_found_where_nothing_is(y):
    found = pnp_sci.register(y, pnp_sci.random_masks((1, 4, 64, 64)))
    assert (found.trusted, found.identity, found.black_level) == (False, True, 0.0)


def test_the_unit_of_y_and_of_the_masks_does_not_matter(scene):
    masks = moved(scene.masks, (0.5, 0.3))
    y = seen_through(masks, scene.truth)
    one, other = pnp_sci.register(y + 1, scene.masks), pnp_sci.register(1000 * (y + 1), 7.0 * scene.masks)
    assert one.transforms[0].displacement((SIZE, SIZE), other.transforms[0]) < 1e-6
    assert other.black_level == pytest.approx(1000 * one.black_level)


@pytest.mark.parametrize("height", [3, 1000])
def test_hot_pixels_mislead_nobody(scene, height):
    y = seen_through(moved(scene.masks, (0.5, 0.3), order=3), scene.truth)
    hot = np.random.default_rng(0).choice(y.size, y.size // 300, replace=False)
    y.flat[hot] = height * y.max()
    found = pnp_sci.register(y, scene.masks)
    assert apart(found.transforms[0], (0.5, 0.3), 0, 1) < 0.05
    assert abs(found.black_level) < 0.02 * np.delete(y, hot).max()


def test_saturated_pixels_are_left_out(scene):
    y = seen_through(moved(scene.masks, (0.5, 0.3), order=3), scene.truth)
    found = pnp_sci.register(np.minimum(y, 0.7 * y.max()), scene.masks)
    assert apart(found.transforms[0], (0.5, 0.3), 0, 1) < 0.05
    assert abs(found.black_level) < 0.02 * y.max()


def test_many_measurements_share_one_estimate(scene):
    masks = moved(scene.masks, (0.5, 0.3))
    stack = np.stack([seen_through(masks, scene.truth[:, ::step]) for step in (1, -1)])
    found = pnp_sci.register(stack, scene.masks)
    alone = [pnp_sci.register(y, scene.masks) for y in stack]
    assert found.errors[0].rows < max(one.errors[0].rows for one in alone)
    assert apart(found.transforms[0], (0.5, 0.3), 0, 1) < 0.05


def test_errors_say_how_far_off_the_estimate_is():
    """Over noise, the estimates scatter as their standard errors say."""
    x = pnp_sci.datasets.embedded_scene(64)
    y = seen_through(moved(x.masks, (0.4, 0.3)), x.truth)
    random = np.random.default_rng(0)
    found = [
        pnp_sci.register(y + 0.05 * y.max() * random.standard_normal(y.shape), x.masks, each_view=False)
        for _ in range(12)
    ]
    scatter = np.std([one.transforms[0].rows for one in found])
    assert 0.3 < scatter / np.mean([one.errors[0].rows for one in found]) < 1.7


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        ({"y": np.ones((64, 32))}, InputError, "masks has 2 x .* frames of 96 x 96, but y"),
        ({"y": np.full((SIZE, SIZE), np.nan)}, InputError, "y has"),
        ({"y": "nothing"}, InputTypeError, "y "),
        ({"y": np.ones((16, 64)), "masks": np.ones((1, 2, 16, 64))}, InputError, "32 pixels a side or more"),
        ({"each_view": "both"}, InputError, "each_view is 'both'"),
        ({"interpolation": "nearest"}, InputError, "interpolation is 'nearest'"),
    ],
)
def test_errors_name_the_argument(scene, change, error, said):
    arguments = {"y": scene.y, "masks": scene.masks} | change
    with pytest.raises(error, match=said):
        pnp_sci.register(arguments.pop("y"), arguments.pop("masks"), **arguments)


def test_the_corrected_masks_can_be_saved(scene, tmp_path):
    found = pnp_sci.register(seen_through(moved(scene.masks, (0.5, 0.3)), scene.truth), scene.masks)
    for name in ("masks.npz", "masks.npy"):
        found.save(tmp_path / name)
        assert np.array_equal(io.read_masks(tmp_path / name), found.masks)
    rows = io.read(tmp_path / "masks.npz", "transforms")
    assert rows[:, 0] == pytest.approx([transform.rows for transform in found.transforms])
    described = json.loads(json.dumps(found.describe()))
    assert described["transforms"][1]["rows"] == found.transforms[1].rows


@pytest.mark.parametrize("black", [0, 0.05])
def test_measurements_alike_count_as_one_for_the_black_level(black):
    """Of the same scene eight measurements have the same errors, so that they tell no more than one."""
    for seed in (0, 3, 11):
        picture = gaussian_filter(np.random.default_rng(seed).random((96, 96)), 1.5)
        truth = np.tile((picture - picture.min()) / np.ptp(picture), (1, 8, 1, 1)).astype(np.float32)
        masks = pnp_sci.random_masks(truth.shape, seed=seed)
        y = np.stack([pnp_sci.simulate(truth, masks, 0.005, seed=n) for n in range(8)])
        found = pnp_sci.register(y + black * y.max(), masks).black_level / y.max()
        assert abs(found - black) < 0.005


@pytest.mark.parametrize("make", [pnp_sci.random_masks, pnp_sci.moving_masks])
@pytest.mark.parametrize("width", [4, 10])
def test_stray_light_in_a_part_of_the_picture_is_no_negative_level(make, width):
    """Bug: it tilts the line of the light against the mean, which then meets 0 at up to minus the maximum of y."""
    picture = gaussian_filter(np.random.default_rng(0).random((SIZE, SIZE)), width)
    masks = make((1, 8, SIZE, SIZE), seed=0)
    y = seen_through(masks, np.tile(0.4 + 0.6 * (picture - picture.min()) / np.ptp(picture), (1, 8, 1, 1)))
    down, right = np.indices((SIZE, SIZE)) / SIZE
    for stray in (np.exp(-((down - 0.7) ** 2 + (right - 0.3) ** 2) / 0.03), down, right):
        for part in (0.15, 0.3):
            assert 0 <= pnp_sci.register(y + part * y.max() * stray, masks).black_level <= part * y.max()


@pytest.mark.parametrize("level", [-0.2, -0.05, 0.03, 0.5])
@pytest.mark.parametrize("contrast", [0.8, 1.25])
def test_a_level_is_found_where_masks_have_another_contrast(scene, level, contrast):
    y = seen_through(scene.masks, scene.truth)
    mean = scene.masks.mean()
    found = pnp_sci.register(y + level * y.max(), mean + contrast * (scene.masks - mean))
    assert found.black_level == pytest.approx(level * y.max(), abs=0.08 * y.max())


def test_values_of_one_block_may_depend_on_each_other():
    random = np.random.default_rng(0)
    x, weight = random.random(20), 1 + random.random(20)
    y = 1 + 2 * x + 0.1 * random.standard_normal(20)
    line, errors = straight_line(x, y, weight)
    again, errors_again = straight_line(*(np.tile(a, (5, 1)) for a in (x, y, weight)))
    np.testing.assert_allclose(again, line, rtol=1e-10)
    np.testing.assert_allclose(errors_again, errors, rtol=1e-10)
    np.testing.assert_allclose(line, [1, 2], atol=3 * np.sqrt(errors.max()))
