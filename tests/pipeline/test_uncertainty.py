"""The predicted error of each pixel: right in the mean, larger where errors are, never a failure."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Result
from pnp_sci.errors import InputError

SCENE = pnp_sci.datasets.embedded_scene(128)


@pytest.fixture(scope="module")
def solved():
    y = pnp_sci.simulate(SCENE.truth, SCENE.masks, noise=0.01, seed=1)
    return y, pnp_sci.solve(y, SCENE.masks, uncertainty=True)


def test_it_is_about_the_true_error(solved):
    _, result = solved
    error = np.abs(result.x - SCENE.truth)
    assert result.uncertainty.dtype == np.float32
    assert result.uncertainty.shape == result.x.shape
    assert np.sqrt((error**2).mean() / (result.uncertainty**2).mean()) == pytest.approx(1, abs=0.4)


def test_it_tells_where_errors_are_large(solved):
    _, result = solved
    large = result.uncertainty > np.median(result.uncertainty)
    squares = (result.x - SCENE.truth) ** 2
    assert squares[large].mean() > 2 * squares[~large].mean()


def test_it_has_the_units_of_the_video(solved):
    y, result = solved
    twice = pnp_sci.solve(3 * y, SCENE.masks, uncertainty=True)
    np.testing.assert_allclose(twice.uncertainty, 3 * result.uncertainty, rtol=1e-2)
    np.testing.assert_array_equal(pnp_sci.solve(y, SCENE.masks).x, result.x)


def test_noise_makes_it_larger(solved):
    _, result = solved
    y = pnp_sci.simulate(SCENE.truth, SCENE.masks, noise=0.1)
    noisy = pnp_sci.solve(y, SCENE.masks, scene="full", uncertainty=True)
    assert noisy.uncertainty.mean() > 1.2 * result.uncertainty.mean()


@pytest.mark.parametrize("suffix", [".npz", ".h5"])
def test_it_is_kept(solved, tmp_path, suffix):
    _, result = solved
    result.save(tmp_path / f"r{suffix}")
    np.testing.assert_array_equal(Result.load(tmp_path / f"r{suffix}").uncertainty, result.uncertainty)


def test_several_measurements_have_one_each(solved):
    y, result = solved
    both = pnp_sci.solve(np.stack([y, y]), SCENE.masks, uncertainty=True)
    np.testing.assert_allclose(both.uncertainty, np.stack([result.uncertainty] * 2), rtol=1e-4)


def test_where_it_cannot_be_said_the_result_says_so():
    masks = pnp_sci.random_masks((1, 4, 8, 8))
    result = pnp_sci.solve(np.ones((8, 8)), masks, uncertainty=True)
    assert np.isnan(result.uncertainty).all()
    assert any("uncertainty: unknown" in remark for remark in result.remarks)
    assert pnp_sci.solve(SCENE.y, SCENE.masks, iterations=1).uncertainty is None


def test_a_time_budget_holds_for_both_solves():
    result = pnp_sci.solve(SCENE.y, SCENE.masks, time_budget=0.5, iterations=10**6, tol=0, uncertainty=True)
    assert np.isfinite(result.uncertainty).all()
    assert result.status is pnp_sci.Status.TIME_BUDGET


def test_it_is_shown(solved):
    _, result = solved
    assert "predicted error 0.0" in repr(result)
    assert "predicted error" in result._repr_html_()
    figure = result.plot([0, 5], uncertainty=True)
    names = [axis.get_ylabel() for axis in figure.axes[::2]]
    assert names == ["view 1", "uncertainty view 1", "view 2", "uncertainty view 2"]
    with pytest.raises(InputError, match="uncertainty=True"):
        pnp_sci.solve(SCENE.y, SCENE.masks, iterations=1).plot(uncertainty=True)


def test_a_callback_stops_the_second_solve_too():
    calls = []
    result = pnp_sci.solve(
        np.stack([SCENE.y] * 2), SCENE.masks, uncertainty=True, callback=lambda state: calls.append(state) or True
    )
    assert len(calls) == 1
    assert np.isnan(result.uncertainty).all()


def test_a_second_solve_that_fails_says_nothing():
    """Bug: the zeros of a solve that had failed were taken for an estimate."""
    calls = []

    def fails_later(x, sigma):
        calls.append(sigma)
        return x if len(calls) <= 5 else np.full_like(x, np.nan)

    y = pnp_sci.simulate(SCENE.truth, SCENE.masks)
    result = pnp_sci.solve(y, SCENE.masks, fails_later, scene="full", iterations=5, uncertainty=True)
    assert result.status.ok
    assert len(calls) > 5
    assert np.isnan(result.uncertainty).all()
    assert any("uncertainty: unknown" in remark for remark in result.remarks)
