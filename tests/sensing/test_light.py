"""How bright frames are: found where light flickers, and only there."""

import numpy as np
import pytest
from hypothesis import given, strategies
from hypothesis.extra.numpy import arrays
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import SensingOperator, Sensor
from pnp_sci.camera.mask_frames import repeated_frames
from pnp_sci.sensing.light import light_of_frames
from pnp_sci.sensing.problem import check_operator, pose

FRAMES = 10
STROBED = np.where(np.arange(FRAMES) % 2, 0.3, 1)
LIGHTS = {"strobed": STROBED, "fading": 0.8 ** np.arange(FRAMES), "mains": 1 + 0.1 * (-1.0) ** np.arange(FRAMES)}


@pytest.fixture(scope="module")
def scene():
    return pnp_sci.datasets.embedded_scene(128)


def distance(found, light):
    """Root mean square; the scene itself changes by about 0.03 of its mean."""
    return np.sqrt(np.mean((found - light / light.mean()) ** 2))


def found(truth, masks, **options):
    op = SensingOperator(masks)
    return light_of_frames(op, op.forward(truth.astype(op.dtype)), **options)[..., 0, 0]


@pytest.mark.parametrize("name", LIGHTS)
@pytest.mark.parametrize("masks", [pnp_sci.random_masks, pnp_sci.moving_masks])
def test_light_that_differs_is_found(scene, name, masks):
    light = LIGHTS[name]
    measured = found(scene.truth * light[:, None, None], masks(scene.truth.shape, seed=0))
    assert distance(measured, light) < 0.05


def test_each_view_has_its_own(scene):
    """One lamp flickers, and the other does not."""
    light = np.stack([np.ones(FRAMES), STROBED])
    measured = found(scene.truth * light[..., None, None], scene.masks)
    assert (measured[0] == 1).all()
    assert distance(measured[1], STROBED) < 0.07


def test_a_steady_scene_that_moves_is_lit_equally(scene):
    for seed in range(5):
        assert (found(scene.truth, pnp_sci.random_masks(scene.truth.shape, seed=seed)) == 1).all()


def test_what_becomes_brighter_in_one_place_is_of_the_scene(scene):
    truth = scene.truth.copy()
    truth[..., 20:60, 20:60] *= STROBED[:, None, None]
    assert (found(truth, scene.masks) == 1).all()


def test_pixels_that_are_not_used_tell_nothing(scene):
    y = SensingOperator(scene.masks).forward((scene.truth * STROBED[:, None, None]).astype(np.float32))
    used = y < np.quantile(y, 0.9)
    first, second = (
        light_of_frames(SensingOperator(scene.masks), np.where(used, y, value), used) for value in (0, 100)
    )
    np.testing.assert_array_equal(first, second)
    assert distance(first[..., 0, 0], STROBED) < 0.1


@pytest.mark.parametrize("frames", [1, 2, 10])
@pytest.mark.parametrize("level", [0, 0.02])
def test_a_dark_view_does_not_tell_its_light(scene, frames, level):
    truth = scene.truth[:, :frames] * np.array([1, level])[:, None, None, None]
    for seed in range(5):
        assert (found(truth, pnp_sci.random_masks(truth.shape, seed=seed)) == 1).all()


def test_masks_of_any_sign_tell_it(scene):
    for masks in (-scene.masks.astype(float), 2.0 * scene.masks - 1):
        assert distance(found(scene.truth * STROBED[:, None, None], masks), STROBED) < 0.1


def test_periodic_masks_tell_it():
    """Each frame has one pixel of every square of two, in pictures of which not all pixels are looked at."""
    masks = np.zeros((1, 4, 256, 256))
    for b in range(4):
        masks[0, b, b // 2 :: 2, b % 2 :: 2] = 1
    film = np.repeat(pnp_sci.datasets.embedded_scene(256).truth[:1, :1], 4, 1)
    assert distance(found(film * STROBED[:4, None, None], masks), STROBED[:4]) < 0.05
    assert repeated_frames(masks) == ()


def test_blurred_masks_tell_nothing(scene):
    """Those of the real captures differ so little from frame to frame that their errors would count as light."""
    masks = gaussian_filter(pnp_sci.moving_masks(scene.truth.shape).astype(float), (0, 0, 1, 1))
    assert (found(scene.truth * STROBED[:, None, None], masks) == 1).all()


def test_masks_that_do_not_differ_tell_nothing(scene):
    masks = np.broadcast_to(pnp_sci.random_masks((2, 1, 128, 128)), scene.truth.shape)
    assert (found(scene.truth * STROBED[:, None, None], masks) == 1).all()


@given(
    arrays(np.float64, strategies.tuples(*[strategies.integers(1, n) for n in (2, 3, 9, 9)]),
           elements=strategies.floats(-1, 1, width=32)),
    strategies.integers(0, 99),
)  # fmt: skip
def test_it_is_positive_and_finite_for_all_masks(masks, seed):
    y = np.random.default_rng(seed).standard_normal(masks.shape[2:])
    light = light_of_frames(SensingOperator(masks), y)
    assert light.shape == (*masks.shape[:2], 1, 1)
    assert (light > 0).all()
    assert np.isfinite(light).all()


def test_the_steady_problem_is_of_the_same_measurement(scene):
    truth = (scene.truth * STROBED[:, None, None]).astype(np.float32)
    y = pnp_sci.simulate(truth, scene.masks)
    op, largest = check_operator(scene.masks, y[None])
    problem = pose(op, largest, y, Sensor(0.0))
    steady = problem.steady()
    assert steady.steady() is steady
    np.testing.assert_allclose(steady.op.forward(truth / steady.unit), steady.y, rtol=1e-4)
    np.testing.assert_allclose(np.mean(steady.unit, 1), problem.unit, rtol=1e-6)
    where = slice(8, 40), slice(0, 24)
    np.testing.assert_allclose(steady.crop(where).op.masks, problem.crop(where).steady().op.masks)
    assert pose(op, largest, pnp_sci.simulate(scene.truth, scene.masks), Sensor(0.0)).light is None
