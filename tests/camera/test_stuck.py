"""Columns and rows of the sensor that are stuck are found; saturated, dark and uniform ones are not stuck."""

import numpy as np
import pytest

from pnp_sci import check_fit, datasets, moving_masks, psnr, random_masks, simulate, solve

LINES = {
    "a column": (slice(None), slice(30, 31)),
    "two columns": (slice(None), slice(30, 32)),
    "a row": (slice(77, 78), slice(None)),
    "half a column": (slice(0, 64), slice(50, 51)),
    "a part of a row": (slice(60, 61), slice(40, 60)),
}


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


def stuck(y, masks):
    return check_fit(y, masks).stuck


@pytest.mark.parametrize("name", LINES)
@pytest.mark.parametrize("level", [0.25, 0.5, 1, 1.3])
@pytest.mark.parametrize("noise", [0, 0.02])
@pytest.mark.parametrize(("make", "dtype"), [(random_masks, float), (moving_masks, np.uint16)])
def test_stuck_lines_are_found(scene, name, level, noise, make, dtype):
    masks = make(scene.masks.shape, seed=3)
    y = np.round(4000 * np.maximum(simulate(scene.truth, masks, noise), 0) / scene.truth.shape[1])
    line = np.zeros(y.shape, bool)
    line[LINES[name]] = True
    y[line] = np.round(level * y.max())
    fit = check_fit(y.astype(dtype), masks)
    assert (fit.stuck & line).sum() == line.sum()
    assert (fit.bad & ~line).sum() <= 2  # a pixel next to the line may have its value
    assert [finding.kind for finding in fit.findings] == ["stuck"]


def test_a_stuck_column_may_have_noise(scene):
    y = simulate(scene.truth, scene.masks, 0.005)
    y[:, 40] = y.mean() * (1 + 0.005 * np.random.default_rng(0).standard_normal(128))
    assert np.array_equal(np.flatnonzero(stuck(y, scene.masks).sum(0) > 64), [40])


@pytest.mark.parametrize("lost", ["0:32, :", "40:128, :", "100:128", "60:68, :"])
@pytest.mark.parametrize("bits", [None, 8])
def test_lines_that_are_0_are_named(scene, lost, bits):
    """As where the readout has stopped. What they hold may also be black, so that they are not left out as a whole."""
    y = simulate(scene.truth, scene.masks, 0.01, bits=bits)
    exec(f"y[..., {lost}] = 0")
    (text,) = (f.text for f in check_fit(y, scene.masks).findings if f.kind == "dead")
    assert text == f"all pixels of y[..., {lost}] are 0"


def test_a_black_background_is_not_dead(scene):
    """A thing with a sharp edge, in front of black: most pixels are 0."""
    disc = np.hypot(*(np.mgrid[:128, :128] - 63.5)) < 20
    y = simulate(scene.truth * disc, scene.masks)
    assert check_fit(y, scene.masks).dead[~disc].mean() < 0.15


def test_it_is_left_out(scene):
    y = scene.y.copy()
    y[:, 40] = 1.2 * y.max()
    kept, left_out = (solve(y, scene.masks, prior="tv", bad=bad) for bad in (None, "auto"))
    assert any("stuck" in str(remark) for remark in kept.remarks)
    assert left_out.scene["bad"] >= 128
    assert psnr(left_out.x, scene.truth).mean() > psnr(kept.x, scene.truth).mean() + 0.5


def noisy(y, sigma):
    return y + sigma * np.random.default_rng(0).standard_normal(y.shape)


HEALTHY = {
    "saturated": lambda y: np.minimum(y, 0.6 * y.max()),
    "saturated, with noise": lambda y: np.minimum(noisy(y, 0.02 * y.std()), 0.6 * y.max()),
    "20 grey levels": lambda y: np.maximum(np.round(noisy(20 * y / y.max(), 0.5)), 0),
    "bytes on a black level": lambda y: (np.round(200 * y / y.max()) + 16).astype(np.uint8),
    "as it is": lambda y: y,
}
SCENES = {
    "uniform": lambda film: 0 * film + 0.5,
    "smooth": lambda film: 0 * film + np.linspace(0.1, 1, film.shape[-1]),
    "half of it dark": lambda film: film * (np.arange(film.shape[-1]) < 64),
    "black lines": lambda film: film * (np.arange(film.shape[-1]) % 16 > 0),
    "bright lines": lambda film: film + 3 * (np.arange(film.shape[-1]) % 16 == 0),
}


def stop(shape, seed):
    """Masks that leave lines dark, open or grey."""
    masks = random_masks(shape, seed=seed).astype(float)
    masks[..., :5], masks[..., 50], masks[..., 33, :] = 0, 1, 0.2
    return masks


@pytest.mark.parametrize("change", HEALTHY)
@pytest.mark.parametrize("light", SCENES)
@pytest.mark.parametrize("make", [random_masks, moving_masks, stop])
def test_healthy_lines_are_not_stuck(scene, change, light, make):
    for views, density in ((1, 0.5), (2, 0.1)):
        masks = make((views, 8, 128, 128), seed=views) if make is stop else make((views, 8, 128, 128), density, seed=1)
        y = simulate(SCENES[light](scene.truth[:views, :8]), masks)
        assert not stuck(HEALTHY[change](y), masks).any()
