"""Bad pixels of the sensor are not used, wherever they come from."""

import logging

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci import datasets, estimate_noise, solve
from pnp_sci.bench import Method, compare
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.operator import SensingOperator


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


@pytest.fixture(scope="module")
def y(scene):
    return pnp_sci.simulate(scene.truth, scene.masks, 0.01)


@pytest.fixture(scope="module")
def bad():
    chosen = np.random.default_rng(0).random((64, 64)) < 0.003
    chosen[20:26, 30:36] = True
    return chosen


@pytest.mark.parametrize("value", [0, 1e4, -1e4, np.nan, np.inf])
@pytest.mark.parametrize("prior", ["tv", "flow"])
def test_what_bad_pixels_hold_does_not_matter(scene, y, bad, value, prior):
    expected = solve(np.where(bad, 0, y), scene.masks, prior, bad=bad, iterations=30)
    result = solve(np.where(bad, np.float32(value), y), scene.masks, prior, bad=bad, iterations=30)
    assert np.array_equal(result.x, expected.x)
    assert result.scenes == expected.scenes
    assert result.settings["noise"] == expected.settings["noise"]
    assert result.scene["bad"] == bad.sum()
    assert result.scene["closed"] == 0


def test_masked_values_are_bad_pixels(scene, y, bad):
    masked = np.ma.MaskedArray(np.where(bad, 1e4, y), bad)
    result = solve(masked, scene.masks, iterations=5)
    assert np.array_equal(result.x, solve(y, scene.masks, bad=bad, iterations=5).x)
    assert (
        pnp_sci.decode(masked, scene.masks, lambda problem, scene: np.zeros(problem.op.shape)).scene["bad"] == bad.sum()
    )
    unmasked = np.ma.MaskedArray(y, False)
    assert np.array_equal(solve(unmasked, scene.masks, iterations=5).x, solve(y, scene.masks, iterations=5).x)


def test_each_measurement_has_its_own_masked_values(scene, y, bad):
    both = np.ma.MaskedArray(np.stack([y, y]), np.stack([bad, ~bad & bad.T]))
    result = solve(both, scene.masks, iterations=5)
    for n in range(2):
        assert np.array_equal(result.x[n], solve(both[n], scene.masks, iterations=5).x)
        assert result.scenes[n]["bad"] == both.mask[n].sum()


def test_a_masked_array_elsewhere_is_refused(scene, y):
    with pytest.raises(InputTypeError, match=r"masks is a masked array with 1 masked values"):
        solve(y, np.ma.masked_equal(np.arange(scene.masks.size).reshape(scene.masks.shape), 7))


def test_not_a_number_names_bad(scene, y):
    with pytest.raises(InputError, match=r"y has 1 values that are NaN .*leaves such pixels out, as does bad="):
        solve(np.where(y == y.max(), np.nan, y), scene.masks)


WRONG = {
    "all": (np.ones((64, 64), bool), InputError, "bad has every pixel"),
    "shape": (np.zeros((64, 63), bool), InputError, r"bad has shape \(64, 63\)"),
    "name": ("hot", InputError, "bad is 'hot'"),
    "floats": (np.zeros((64, 64)), InputTypeError, "bad has dtype float64"),
}


@pytest.mark.parametrize("name", WRONG)
def test_errors_name_bad(scene, y, name):
    bad, error, text = WRONG[name]
    for call in (solve, pnp_sci.decode, pnp_sci.check_fit):
        with pytest.raises(error, match=text):
            call(y, scene.masks, bad=bad)


def test_hot_pixels_are_found_and_left_out(caplog):
    scene = datasets.embedded_scene(128)
    y = pnp_sci.simulate(scene.truth, scene.masks, 0.01)
    rng = np.random.default_rng(0)
    hot = np.where(rng.random(y.shape) < 0.003, y.max() * rng.uniform(5, 50, y.shape), y).astype("f4")
    clean = pnp_sci.psnr(solve(y, scene.masks).x, scene.truth)
    with caplog.at_level(logging.WARNING, "pnp_sci"):
        found = solve(hot, scene.masks, bad="auto")
    assert not caplog.records
    assert not found.remarks
    assert found.scene["bad"] == (hot != y).sum()
    assert (pnp_sci.psnr(found.x, scene.truth) > clean - 0.3).all()
    same = solve(y, scene.masks, bad="auto")
    assert same.scene["bad"] == 0
    assert np.array_equal(same.x, solve(y, scene.masks).x)


def test_the_noise_is_that_of_the_good_pixels():
    op = SensingOperator(pnp_sci.random_masks((2, 4, 64, 64)))
    rng = np.random.default_rng(0)
    y = op.forward(np.full(op.shape, 0.5)) + 0.3 * rng.standard_normal((64, 64))
    bad = rng.random(y.shape) < 0.1
    bad[:, :16] = True  # a quarter of the blocks has nothing else
    assert estimate_noise(op, np.where(bad, 50, y), bad=bad) == pytest.approx(0.3, rel=0.15)


def test_each_measurement_may_have_its_own(scene, y):
    """As where the measurements are a masked array."""
    two, bad = np.stack([y, 2 * y]), np.zeros((2, 64, 64), bool)
    bad[0, 3:6, 4], bad[1, 20, 30:33] = True, True
    given, masked = (
        solve(two, scene.masks, bad=bad, iterations=3),
        solve(np.ma.array(two, mask=bad), scene.masks, iterations=3),
    )
    assert np.array_equal(given.x, masked.x)
    assert [found["bad"] for found in given.scenes] == [3, 3]
    for wrong in (bad[:1], np.concatenate([bad, bad])):
        with pytest.raises(InputError, match="bad has shape"):
            solve(two, scene.masks, bad=wrong)


def test_dead_pixels_are_simulated(scene, bad):
    y = pnp_sci.simulate(scene.truth, scene.masks, 0.1, bad=bad)
    assert np.array_equal(y, np.where(bad, 0, pnp_sci.simulate(scene.truth, scene.masks, 0.1)))
    with pytest.raises(InputError, match="bad has shape"):
        pnp_sci.simulate(scene.truth, scene.masks, bad=bad[1:])


def test_comparisons_leave_them_out_and_say_it_once(scene, y, bad, caplog):
    methods = [Method("tv", iterations=3), Method("none", iterations=3)]
    clean = compare(np.where(bad, 0, y), scene.masks, methods, bad=bad)
    with caplog.at_level(logging.WARNING, "pnp_sci"):
        dirty = compare(np.where(bad, 1e4, y), scene.masks, methods, bad=bad)
        assert not caplog.records
        compare(y, scene.masks[:, :, ::-1], methods)
        assert len(caplog.records) == 1
    assert [trial.score for trial in dirty.trials] == [trial.score for trial in clean.trials]
    assert all(np.array_equal(a.result.x, b.result.x) for a, b in zip(dirty.trials, clean.trials))
    assert "Bad" in dirty.facts


def test_faint_hot_pixels_are_found_by_what_an_estimate_does_not_explain():
    """Pixels 1.2 to 3 times as bright as around them: most of their error is gone, and clean pixels stay."""
    scene = datasets.embedded_scene(128)
    y = pnp_sci.simulate(scene.truth, scene.masks)
    rng = np.random.default_rng(2)
    chosen = rng.random(y.shape) < 0.003
    hot = np.where(chosen, gaussian_filter(y, 2) * rng.uniform(1.2, 3, y.shape), y).astype("f4")
    masks, seen = scene.masks, []

    def noted(problem, scene):
        seen.append(problem.bad)
        return np.zeros(problem.op.shape)

    pnp_sci.decode(hot, masks, noted, bad="auto")
    pnp_sci.decode(y, masks, noted, bad="auto")
    found, clean = seen
    assert np.sum((hot - y)[~found] ** 2) < 0.5 * np.sum((hot - y) ** 2)
    assert (found & ~chosen).mean() < 1e-3
    assert clean is None


@pytest.mark.parametrize("how", ["picture", "masked", "auto"])
def test_a_measurement_of_float16_may_have_them(scene, y, bad, how):
    half = y.astype(np.float16)
    half[40, 40] = 60 * y.max()
    bad = "auto" if how == "auto" else bad | (half == half.max())
    given = np.ma.MaskedArray(half, bad) if how == "masked" else half
    options = {} if how == "masked" else {"bad": bad}
    result = solve(given, scene.masks, iterations=3, **options)
    assert result.scene["bad"] > 0
    assert np.array_equal(result.x, solve(half.astype("f4"), scene.masks, iterations=3, bad=bad).x)
    decoded = pnp_sci.decode(given, scene.masks, lambda problem, scene: np.zeros(problem.op.shape), **options)
    assert decoded.scene["bad"] == result.scene["bad"]


def test_a_measurement_without_them_is_solved_as_alone(scene, y, bad):
    both = solve(np.stack([y, y]), scene.masks, bad=np.stack([bad, np.zeros_like(bad)]), iterations=5)
    for n, own in enumerate((bad, None)):
        alone = solve(y, scene.masks, bad=own, iterations=5)
        assert np.array_equal(both.x[n], alone.x)
        assert both.scenes[n] == alone.scene


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_values_that_are_not_finite_are_found(scene, y, bad, value):
    """As if they had been named; without "auto" they are refused, and the message says so."""
    broken = np.where(bad, np.float32(value), y)
    found = solve(broken, scene.masks, bad="auto", iterations=5)
    assert np.array_equal(found.x, solve(np.ma.MaskedArray(y, bad), scene.masks, bad="auto", iterations=5).x)
    with pytest.raises(InputError, match='bad="auto" leaves such pixels out'):
        solve(broken, scene.masks)
