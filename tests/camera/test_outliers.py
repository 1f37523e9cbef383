"""Hot and dead pixels are found, highlights are none."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pnp_sci import check_fit, datasets, moving_masks, random_masks, simulate
from pnp_sci.camera.groups import hot_groups
from pnp_sci.camera.scattered import scattered_hot


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


@pytest.fixture(scope="module")
def bad():
    chosen = np.zeros((128, 128), bool)
    chosen.flat[np.random.default_rng(0).choice(chosen.size, 50, replace=False)] = True
    return chosen


@pytest.mark.parametrize("noise", [0, 0.01, 0.1])
def test_hot_pixels_are_found(scene, bad, noise):
    y = simulate(scene.truth, scene.masks, noise)
    hot = np.where(bad, y.max() * np.random.default_rng(1).uniform(5, 50, y.shape), y)
    fit = check_fit(hot, scene.masks)
    assert np.array_equal(fit.hot, bad)
    assert [finding.kind for finding in fit.findings] == ["hot"]
    assert fit.follows == pytest.approx(check_fit(y, scene.masks).follows, abs=0.05)


def test_dead_pixels_are_found_where_there_is_light(scene, bad):
    y = simulate(scene.truth, scene.masks, 0.01)
    fit = check_fit(np.where(bad, 0, y), scene.masks)
    missed = y[bad & ~fit.dead]
    assert np.sum(missed**2) < 0.4 * np.sum(y[bad] ** 2)
    assert not (fit.bad & ~bad).any()
    assert [finding.kind for finding in fit.findings] == ["dead"]


@pytest.mark.parametrize("size", [0.7, 1.0, 2.0])
def test_small_highlights_are_no_hot_pixels(scene, size):
    """Points of light, spread by the lens, 10 times as bright as the scene."""
    points = np.zeros((128, 128))
    points[8::16, 8::16] = 1
    points = gaussian_filter(points, size)
    film = scene.truth + 10 * points / points.max()
    assert not check_fit(simulate(film, scene.masks, 0.01), scene.masks).bad.any()


def test_a_view_that_is_dark_makes_no_outliers():
    scene = datasets.embedded_scene(128)
    masks = random_masks((2, 3, 128, 128), 0.4, seed=1)
    film = scene.truth[:, :3] * np.array([1, 0.02])[:, None, None, None]
    fit = check_fit(simulate(film, masks), masks)
    assert fit.ok
    assert fit.bad.sum() <= 1


@pytest.mark.parametrize("value", [-1, -100, -999, -32768])
@pytest.mark.parametrize("noise", [0, 0.01])
@pytest.mark.parametrize("part", [0.0003, 0.01, 0.08])
def test_values_that_stand_for_no_data_are_found(scene, value, noise, part):
    y = simulate(scene.truth, scene.masks, noise, seed=1)
    lost = np.random.default_rng(0).random(y.shape) < part
    fit = check_fit(np.where(lost, np.float32(value), y), scene.masks)
    assert not (fit.bad & ~lost).any()
    assert (fit.dead & lost).sum() >= 0.99 * lost.sum() - 1
    assert [finding.kind for finding in fit.findings] == ["dead"] * (part > 0.001 or value < -1)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.5])
def test_noise_about_zero_makes_no_dead_pixels(scene, noise):
    dark = np.clip(scene.truth - 0.7, 0, None)
    for masks in (scene.masks, random_masks(scene.masks.shape, 0.1)):
        y = simulate(dark, masks, noise, seed=1)
        assert not check_fit(y, masks).bad.any()
        assert check_fit(np.round(y * 50), masks).bad.sum() <= 1


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("seed", range(3))
def test_a_few_hot_pixels_are_said_and_points_of_light_are_not(scene, make, seed):
    """0.2 % of the pixels cost 1 to 7 dB. What hot pixels add does not rise with the masks, as points of light do."""
    film = scene.truth[:1, :8]
    rng, masks = np.random.default_rng(seed), make(film.shape, seed=seed)
    y = simulate(film, masks, 0.005)
    chosen = rng.random(y.shape) < 0.002
    hot = check_fit(y + chosen * rng.uniform(0.5, 1.2, y.shape) * y.max(), masks)
    assert [finding.kind for finding in hot.findings] == ["hot"]
    lit = check_fit(simulate(film + chosen * rng.uniform(0.5, 2, y.shape), masks, 0.005), masks)
    assert lit.hot.any()
    assert lit.ok


GROUPS = {
    "two columns": (slice(None), slice(30, 32)),
    "a row": (slice(77, 78), slice(None)),
    "a part of a column": (slice(40, 60), slice(50, 51)),
    "a block": (slice(60, 64), slice(60, 64)),
}


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.parametrize("views", [1, 2])
def test_groups_of_hot_pixels_are_found(scene, name, views):
    masks = scene.masks[:views]
    y = simulate(scene.truth[:views], masks, 0.005)
    hot = np.zeros(y.shape, bool)
    hot[GROUPS[name]] = True
    fit = check_fit(np.where(hot, y.max() * np.random.default_rng(1).uniform(3, 4, y.shape), y), masks)
    assert np.array_equal(fit.hot, hot)


@pytest.mark.parametrize("name", GROUPS)
@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("frames", [slice(None), slice(3, 4), slice(3, 6)])
def test_sharp_bright_light_makes_no_hot_groups(scene, name, make, frames):
    """A slit or a spot, in all frames or as a flash in some of them, 10 times as bright as the scene."""
    masks = make((2, 10, 128, 128), 0.7, seed=2)
    film = scene.truth.copy()
    film[(0, frames, *GROUPS[name])] += 10
    y = simulate(film, masks, 0.005)
    for seen in (y, np.minimum(y, 0.4 * y.max())):  # also by a camera that is saturated
        assert not hot_groups(seen, masks, np.ones(y.shape, bool)).any()


@pytest.mark.parametrize("size", [4, 6, 9])
@pytest.mark.parametrize("make", [random_masks, moving_masks])
def test_small_bright_movers_make_no_hot_groups(make, size):
    """Each pixel that a mover crosses is lit in another frame, so that they follow no mask."""
    film, mover = np.full((1, 8, 96, 96), 0.03), np.random.default_rng(0).uniform(0.7, 1, (size, size))
    for b in range(8):
        film[0, b, 40 : 40 + size, 10 + b * size : 10 + (b + 1) * size] = mover
    masks = make(film.shape, seed=2)
    assert not hot_groups(simulate(film, masks, 0.005), masks, np.ones((96, 96), bool)).any()


@pytest.mark.parametrize("part", [0.015, 0.02, 0.05])
@pytest.mark.parametrize("views", [1, 2])
@pytest.mark.parametrize("most", [2, 10])
def test_many_hot_pixels_are_found(scene, part, views, most):
    """At the camera's ceiling, which is no saturation."""
    y, rng = simulate(scene.truth[:views], scene.masks[:views], 0.01, seed=1), np.random.default_rng(0)
    hot = rng.random(y.shape) < part
    fit = check_fit(np.where(hot, most * y.max(), y), scene.masks[:views])
    assert fit.hot[hot].mean() > 0.99
    assert not (fit.bad & ~hot).any()
    assert [finding.kind for finding in fit.findings] == ["hot"]


@pytest.mark.parametrize("make", [random_masks, moving_masks])
@pytest.mark.parametrize("density", [0.1, 0.5])
def test_much_bright_light_is_not_many_hot_pixels(scene, make, density):
    """A flash, points of light that stay, that flash, and bright movers."""
    film, rng, shape = scene.truth[:1, :8], np.random.default_rng(0), (1, 8, 128, 128)
    masks = make(shape, density, seed=1)
    flash = film * np.where(np.arange(8) == 3, 20, 1)[:, None, None]
    points = film + 10 * (rng.random((128, 128)) < 0.03)
    movers = 0.1 * film + (np.arange(128) // 4 % 16 == 2 * np.arange(8)[:, None, None])
    flashes = film + 10 * (rng.random(shape[1:]) < 0.005)
    for light in (flash, points, flashes, movers):
        y = simulate(light, masks, 0.01, seed=1)
        clipped = [] if light is flashes else [np.minimum(y, 0.5 * y.max())]
        for seen in (y, *clipped):
            weight = masks.sum((0, 1), dtype=np.float32)
            assert not scattered_hot(seen, weight, masks, np.ones(y.shape, bool)).any()
