"""How strongly to denoise and how far to trust the data, from the noise and the masks."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import SensingOperator
from pnp_sci.solvers.schedule import contrast, element, opposition, schedule_for
from priors.tv import TV


def planes_of(views, frames):
    return SensingOperator(pnp_sci.random_masks((views, frames, 48, 48), seed=1))


def test_the_contrast_of_masks():
    """Half of 20 open is what the tolerance was made for; dense masks, and more of them, code less of y."""
    half, dense, many = (
        contrast(SensingOperator(pnp_sci.random_masks(shape, density)))
        for shape, density in (((2, 10, 32, 32), 0.5), ((2, 10, 32, 32), 0.95), ((2, 60, 32, 32), 0.5))
    )
    assert half > 0.95
    assert dense == pytest.approx(np.sqrt(0.05 / 0.95 / 20) / 0.22, rel=0.1)
    assert many == pytest.approx(np.sqrt(1 / 120) / 0.22, rel=0.1)
    for edge in (np.ones((2, 3, 4, 4)), np.zeros((2, 3, 4, 4)), np.ones((1, 1, 4, 4)), np.array([[[[1.0]], [[-1.0]]]])):
        assert contrast(SensingOperator(edge)) == 1


SIZES = (1, 1), (2, 1), (1, 8), (2, 6), (2, 10), (3, 16)


def test_noise_counts_the_more_the_fewer_frames_there_are():
    """In units of the variance, at the same noise in a pixel of x; faint noise counts twice as much as strong noise."""

    def product(op, in_x):
        noise = in_x * np.sqrt(np.mean(op.gram))
        return schedule_for(op, noise).product / noise**2 * (1 + in_x)

    strong, middle, faint = (
        np.array([product(planes_of(*size), in_x) for size in SIZES]) for in_x in (1e3, 0.03, 1e-6)
    )
    for each in (strong, middle, faint):
        np.testing.assert_allclose(each * [1 + min(views * frames, 20) for views, frames in SIZES], 2 * each[0])
    np.testing.assert_allclose([faint / strong, middle / strong], [[2.0] * 6, [1.5] * 6], rtol=1e-5)


def test_a_schedule_may_be_told_another_noise():
    """sigma begins where it did; all else is as if that noise had been known from the beginning."""
    op = planes_of(2, 10)
    told = schedule_for(op, 0.4).settling(3, 9).told(op, 0.1)
    known = schedule_for(op, 0.1).settling(3, 9)
    assert (told.product, told.settled, told.begins, told.ends) == (
        known.product, known.settled, known.begins, known.ends
    )  # fmt: skip
    assert told.sigma == schedule_for(op, 0.4).sigma


def blocks(shape, side):
    """Random masks of square elements."""
    views, frames, rows, columns = shape
    small = pnp_sci.random_masks((views, frames, -(-rows // side), -(-columns // side)), seed=2)
    return small.repeat(side, 2).repeat(side, 3)[:, :, :rows, :columns].astype(np.float64)


@pytest.mark.parametrize("side", [1, 2, 3, 4])
@pytest.mark.parametrize("shape", [(1, 8, 96, 96), (2, 3, 64, 128)])
def test_the_side_of_mask_elements(shape, side):
    masks = blocks(shape, side)
    lamp = 0.3 + np.hypot(*np.meshgrid(*(np.linspace(0, 1, n) for n in shape[:1:-1])))
    grey = -3 * masks * 0.2 + 0.5  # another level and contrast
    for seen in (masks, masks + 5 * lamp, grey):
        assert element(SensingOperator(seen)) == pytest.approx(side, rel=0.15)


def test_blurred_masks_have_larger_elements():
    masks = blocks((2, 4, 80, 80), 1)
    sides = [element(SensingOperator(gaussian_filter(masks, (0, 0, blur, blur)))) for blur in (0.3, 0.5, 0.7, 1.0)]
    assert sides == sorted(sides)
    assert sides[0] < 1.1
    assert 2 < sides[2] < 2.6


@pytest.mark.parametrize(
    "masks",
    [
        np.ones((2, 3, 8, 8)),
        np.zeros((1, 2, 8, 8)),
        blocks((1, 1, 8, 8), 2),
        np.eye(2)[None, None, :1],
        np.ones((2, 10, 1, 1)),
        blocks((1, 1, 30, 30), 2).repeat(4, 1),
    ],
)
def test_masks_that_do_not_change_have_elements_of_one_pixel(masks):
    assert element(SensingOperator(masks)) == 1


@pytest.mark.parametrize("factor", [1e-161, 1e152, -3.0])
def test_the_unit_of_the_masks_does_not_matter(factor):
    with np.errstate(over="raise", invalid="raise", divide="raise"):
        assert element(SensingOperator(factor * blocks((1, 4, 60, 60), 2))) == pytest.approx(2, rel=0.1)


def test_frames_and_views_of_other_brightness_are_no_elements():
    """Neither a closed shutter nor shading is a pattern; a tile that is repeated has the elements of the tile."""
    masks, (rows, columns) = blocks((2, 10, 96, 96), 1), np.mgrid[0.2:1.2:96j, 0.2:1.2:96j]
    first = (np.arange(10) == 0)[:, None, None]
    for seen in (
        np.where(first, 0.0, masks * rows),
        (0.4 + 0.3 * masks) * rows * np.where(first, 0.5, 1),
        (0.4 + 0.2 * masks) * np.stack([rows, columns])[:, None],
        np.tile(masks[..., :4, :4], (24, 24)),
        np.tile(masks[..., :3, :3], (32, 32)),
    ):
        assert element(SensingOperator(seen)) < 1.2


def test_without_noise_the_data_are_met_and_sigma_is_the_same_for_few_frames():
    quiet = [schedule_for(planes_of(*size), 0) for size in ((2, 3), (1, 8), (2, 6), (2, 10))]
    assert len({schedule.at(iteration) for schedule in quiet for iteration in (0, 1, 30, 500)}) == 1
    sigma, rho = quiet[0].at(0)
    assert sigma > 0
    assert rho == 0


def test_sigma_grows_with_mask_elements_and_frames():
    usual = schedule_for(planes_of(2, 10), 0)
    coarse, many, few = (
        schedule_for(SensingOperator(blocks(s, 3)), 0) for s in ((2, 10, 96, 96), (2, 20, 96, 96), (1, 2, 96, 96))
    )
    assert coarse.sigma == pytest.approx(3 * usual.sigma, rel=0.1)
    assert many.sigma == pytest.approx(np.sqrt(2) * coarse.sigma, rel=0.1)
    assert few.sigma == usual.sigma


def test_noise_takes_calls_away_where_it_is_louder_than_the_errors_of_coarse_masks():
    op = SensingOperator(blocks((2, 10, 96, 96), 3))
    calls = [schedule_for(op, noise).enough(20, 100) for noise in (0, 1e-9, 1.0, 3.0, 10.0)]
    assert calls[:3] == [100, 80, 80]
    assert 20 <= calls[4] <= calls[3] < 40
    given = [schedule_for(op, 1e-9, sigma=sigma).enough(20, 100) for sigma in (0.05, 0.15, 0.5)]
    assert given[:2] == [80, 80]
    assert given[2] < 40


@pytest.mark.parametrize("noise", [0.1, 1.0, 3.0])
def test_noise_raises_sigma_above_that_of_the_masks_only_if_it_would_without_them(noise):
    """Coarse masks and noise together do not hide the motion."""
    fine, coarse = (SensingOperator(blocks((2, 10, 96, 96), side)) for side in (1, 3))
    loud, both, quiet = (schedule_for(*of).sigma for of in ((fine, noise), (coarse, noise), (coarse, 0)))
    assert both == pytest.approx(max(loud, quiet), rel=0.1)
    assert schedule_for(SensingOperator(blocks((2, 20, 96, 96), 12)), 0).sigma == pytest.approx(0.25)


def test_coarse_masks_are_solved_better_than_with_a_fixed_sigma():
    scene = pnp_sci.datasets.embedded_scene(96)
    masks = blocks(scene.masks.shape, 3)
    y = pnp_sci.simulate(scene.truth, masks)
    fixed, ruled = (
        pnp_sci.solve(y, masks, "tv", sigma=s, init="adjoint", scene="full", iterations=30) for s in (0.05, None)
    )
    assert np.mean(pnp_sci.psnr(ruled.x, scene.truth)) > np.mean(pnp_sci.psnr(fixed.x, scene.truth)) + 0.5
    assert ruled.settings["plan"][0]["sigma"][0] > 0.1


@pytest.mark.parametrize("size", [(1, 8), (2, 20)])
def test_more_noise_is_a_larger_sigma_and_the_product_stays(size):
    schedules = [schedule_for(planes_of(*size), noise).settling(5, 20) for noise in (0.0, 0.5, 1.0, 2.0, 4.0)]
    sigmas = [schedule.at(0)[0] for schedule in schedules]
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] > 2 * sigmas[0]
    for schedule in schedules:
        assert all(sigma * rho == pytest.approx(schedule.product) for sigma, rho in map(schedule.at, range(30)))


def test_sigma_falls_while_a_strong_prior_serves_and_less_with_noise():
    left = []
    for noise in (0.0, 0.1, 1.0, 10.0):
        schedule = schedule_for(planes_of(2, 10), noise).settling(5, 20)
        sigmas = [schedule.at(iteration)[0] for iteration in range(30)]
        assert len(set(sigmas[:16])) == len(set(sigmas[20:])) == 1
        assert len(set(sigmas[15:21])) == 6
        assert sigmas == sorted(sigmas, reverse=True)
        left.append(sigmas[-1] / sigmas[0])
    assert left == sorted(left)
    assert left[0] < 0.8
    assert left[-1] == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(("value", "dtype"), [(1e-161, np.float64), (1e-22, np.float32)])
def test_masks_near_the_smallest_number_leave_sigma_finite(value, dtype):
    op = SensingOperator(np.full((1, 2, 4, 4), value, dtype))
    for noise in (0.0, np.zeros((4, 4), dtype)):
        schedule = schedule_for(op, noise).settling(0, 9)
        assert all(np.isfinite(rho).all() and 0 < sigma < 1 for sigma, rho in map(schedule.at, range(10)))


@pytest.mark.parametrize("ends", [0, 5])
def test_one_call_of_a_strong_prior_has_the_first_sigma(ends):
    schedule = schedule_for(planes_of(1, 8), 0).settling(5, ends)
    assert len({schedule.at(iteration)[0] for iteration in range(9)}) == 1


def test_a_given_sigma_stays_as_it_is():
    schedule = schedule_for(planes_of(1, 8), 0.3, sigma=0.1).settling(0, 20)
    assert {schedule.at(iteration)[0] for iteration in (0, 1, 50)} == {0.1}
    assert schedule.product == schedule_for(planes_of(1, 8), 0.3).product


def test_without_noise_tv_takes_changes_along_time_for_motion():
    """Its weights along time come to follow the scene, and no longer are one for all pixels."""
    scene = pnp_sci.datasets.embedded_scene(64)
    sigma = schedule_for(planes_of(2, 20), 0).sigma
    session = TV().begin(scene.truth.shape, scene.truth.dtype)
    for _ in range(45):
        session(scene.truth, sigma)
    assert np.ptp(session.weights) > 0


def test_noise_takes_calls_away_and_no_noise_none():
    op = planes_of(2, 20)
    calls = [schedule_for(op, noise).enough(20, 50) for noise in (0, 1e-9, 0.5, 2.0, 9.0)]
    assert calls[:2] == [50, 50]
    assert calls == sorted(calls, reverse=True)
    assert 20 <= calls[-1] < 50, "those of the fast effort remain"


def test_a_sigma_of_zero_beside_noise_is_no_error():
    schedule = schedule_for(planes_of(2, 10), 0.3, sigma=0.0)
    assert schedule.at(3) == (0.0, 0.0)
    assert schedule.enough(20, 50) == 50


def test_noise_of_each_pixel_makes_its_own_product():
    op = planes_of(1, 8)
    noise = np.array([[0.0, 0.1], [0.3, 0.5]]).repeat(12, 0).repeat(12, 1)
    alone = [schedule_for(op, float(n)).product for n in noise.flat]
    np.testing.assert_allclose(schedule_for(op, noise).product, np.reshape(alone, noise.shape))


def opposite(shape=(2, 6, 48, 48), noise=0.0):
    """Masks of two views that add up to 1, but for some noise."""
    random = np.random.default_rng(5)
    masks = random.integers(0, 2, shape).astype(np.float32)
    masks[1] = 1 - masks[0]
    return masks + noise * random.standard_normal(shape).astype(np.float32)


@pytest.mark.parametrize("factor", [1e-12, 1.0, 1e12])
def test_masks_that_add_up_to_one_leave_twice_as_much_open(factor):
    assert opposition(SensingOperator(factor * opposite())) == 2
    assert 1.4 < opposition(SensingOperator(factor * opposite(noise=0.2))) < 2


@pytest.mark.parametrize("density", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("shape", [(1, 1, 16, 16), (1, 8, 32, 32), (2, 10, 64, 64), (3, 14, 48, 48)])
def test_independent_masks_are_not_opposite(shape, density):
    masks = pnp_sci.random_masks(shape, density, seed=3).astype(np.float32)
    rows = np.linspace(-1, 1, shape[2])
    vignette = np.exp(-(rows[:, None] ** 2) - rows**2).astype(np.float32)
    light = np.linspace(0.3, 1.7, shape[0] * shape[1]).astype(np.float32).reshape(*shape[:2], 1, 1)
    for some in (masks, masks * vignette, 0.3 * masks + 0.6, masks * light):
        assert opposition(SensingOperator(some)) == pytest.approx(1, abs=0.03)


@pytest.mark.parametrize("masks", [np.zeros((2, 3, 8, 8)), np.ones((2, 3, 8, 8)), np.full((1, 2, 4, 4), 1e300)])
def test_masks_that_say_nothing_are_not_opposite(masks):
    assert opposition(SensingOperator(masks)) == 1


def test_masks_that_are_opposite_get_more_calls():
    schedule = schedule_for(SensingOperator(opposite()), 0.0)
    assert schedule.enough(20, 50) == round(50 * schedule.opposition)
    assert schedule_for(SensingOperator(opposite()), 9.0).enough(20, 50) < 25


@pytest.mark.parametrize("side", [2, 4, 8])
def test_independent_elements_are_not_opposite(side):
    assert opposition(SensingOperator(blocks((2, 10, 64, 64), side))) <= 1.1


def test_frames_that_are_tied_are_not_opposite():
    op = SensingOperator(pnp_sci.random_masks((2, 8, 48, 48), seed=2))
    for still in ((True, False), (False, True), (True, True)):
        assert opposition(pnp_sci.SceneModel((True, True), still).reduce(op)) == 1


def test_masks_that_resemble_each_other_are_not_opposite():
    moving = gaussian_filter(pnp_sci.moving_masks((1, 14, 64, 64), seed=1).astype(np.float32), (1, 0, 1, 1))
    assert opposition(SensingOperator(moving)) <= 1.1
