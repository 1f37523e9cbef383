"""Hot and dead pixels are found, highlights are none."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from pnp_sci import check_fit, datasets, random_masks, simulate


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
