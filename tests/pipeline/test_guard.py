"""Numerical failures: the estimate with the smallest residual is returned, and the record is of the same estimate."""

import numpy as np
import pytest
from made_priors import Made

import pnp_sci
from pnp_sci import Status, Traits, datasets, solve
from pnp_sci.plugins import registry


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def residual_of(x, scene):
    missing = scene.y - pnp_sci.SensingOperator(scene.masks).forward(x.astype(np.float64))
    return np.linalg.norm(missing) / np.linalg.norm(scene.y)


def diverging(calm, average=False):
    """A prior that does well for some calls, and then more and more harm; the residual falls before it grows."""
    from priors.tv import TV

    tv, calls = TV(), []

    def call(v, sigma):
        if not calls:
            calls.append(tv.begin(v.shape, v.dtype))
        calls.append(sigma)
        x = calls[0](v, sigma)
        return x if len(calls) < calm + 2 else x * np.float32(1 + 0.3 * (len(calls) - calm))

    return Made(call, known=Traits(average=average))


@pytest.mark.parametrize("average", [False, True])
@pytest.mark.parametrize("algorithm", ["gap", "admm"])
def test_history_psnr_and_video_are_of_the_same_estimate(scene, algorithm, average):
    """GAP and ADMM diverge with such a prior: of all estimates that they had, the best by its residual comes back."""
    states = []
    result = solve(
        scene.y, scene.masks, diverging(12, average), algorithm=algorithm, iterations=300, tol=0, scene="full",
        reference=scene.truth, callback=states.append, noise=0.0,
    )  # fmt: skip
    assert result.status is Status.DIVERGED
    last = result.history[-1]
    residuals = [np.linalg.norm(state.residual) for state in states]
    assert last.iteration == states[int(np.argmin(residuals))].iteration
    assert 0 < last.iteration < len(states) - 1, "it is neither the first nor the last"
    best = states[int(np.argmin(residuals))].x * result.settings["unit"][0]
    np.testing.assert_allclose(result.x, best, rtol=1e-5, atol=1e-6)
    assert last.residual == pytest.approx(residual_of(result.x, scene), rel=1e-3)
    assert last.residual == result.history["residual"].min()
    assert last.psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x, scene.truth)), abs=1e-3)
    assert last.ssim == pytest.approx(np.mean(pnp_sci.ssim(result.x, scene.truth)), abs=1e-3)
    assert [record.iteration for record in result.history] == list(range(last.iteration + 1))
    with pytest.raises(pnp_sci.errors.SolverError):
        result.raise_for_status()


@pytest.mark.parametrize("backend", ["numba", "torch"])
@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
@pytest.mark.parametrize("gain", [1.1, 1.3, 2])
def test_a_prior_that_amplifies_is_caught(scene, gain, algorithm, backend):
    """Also where that does not show in y, as it is elements that the masks leave closed that grow."""
    if backend == "torch":
        pytest.importorskip("torch")
    result = solve(
        scene.y, scene.masks, lambda x, sigma: gain * x, iterations=100, algorithm=algorithm, backend=backend
    )  # fmt: skip
    assert result.status is Status.DIVERGED
    assert np.abs(result.x).max() < 3 * scene.truth.max()


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
def test_a_video_that_explains_nothing_has_not_converged(scene, algorithm):
    result = solve(scene.y, scene.masks, lambda x, sigma: 0 * x, algorithm=algorithm)
    assert result.status is not Status.CONVERGED
    assert any("explains nothing" in remark for remark in result.remarks)


@pytest.mark.parametrize("sequence", [False, True])
@pytest.mark.parametrize(("prior", "iterations"), [("tv", 2), ("flow", 64)])
def test_masks_that_are_all_0_are_not_the_priors_fault(scene, sequence, prior, iterations):
    given = {"init": "adjoint", "scene": "full", "iterations": iterations, "sequence": sequence}
    result = solve([scene.y] * 2, 0 * scene.masks, prior, **given)
    assert any("masks are all 0" in remark for remark in result.remarks)
    assert not any("prior" in remark for remark in result.remarks)


def test_a_video_of_noise_alone_needs_to_explain_nothing(scene):
    noise = np.random.default_rng(0).normal(0, 1, scene.y.shape)
    result = solve(noise, scene.masks, lambda x, sigma: 0 * x, scene="full", noise=1.05)
    assert result.status is Status.CONVERGED
    assert not any("explains nothing" in remark for remark in result.remarks)


def test_a_point_of_light_in_the_dark_is_no_failure(scene):
    """It is a thousand times as bright as most of the picture, from whose level the units come."""
    video = np.full_like(scene.truth, 0.01)
    video[:, :, 30, 30] = 100
    result = solve(pnp_sci.simulate(video, scene.masks), scene.masks, scene="full")
    assert result.status.ok
    assert result.x[0, :, 30, 30].max() > 10


def test_a_prior_that_returns_nan_is_caught(scene):
    def spoiled(x, sigma):
        spoiled.calls += 1
        return x * np.nan if spoiled.calls > 3 else x.copy()

    spoiled.calls = 0
    result = solve(scene.y, scene.masks, prior=spoiled)
    assert result.status is Status.NOT_FINITE
    assert np.isfinite(result.x).all()
    assert result.x.any()


def test_a_prior_may_return_what_numpy_understands(scene):
    """Lists, and values that float32 cannot hold, which the guard finds."""
    listed, plain = (solve(scene.y, scene.masks, p, iterations=3) for p in (lambda x, sigma: x.tolist(), "none"))
    np.testing.assert_array_equal(listed.x, plain.x)
    huge = solve(scene.y, scene.masks, lambda x, sigma: x + np.float64(1e300), iterations=3)
    assert huge.status is Status.NOT_FINITE
    assert np.isfinite(huge.x).all()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_bad_value_that_no_mask_lets_through_is_caught(scene, value):
    """The guard looks at the residual alone."""
    masks = scene.masks.copy()
    masks[:, :, 3, 4] = 0

    def spoiled(x, sigma):
        x = x.copy()
        x[0, 0, 3, 4] = value
        return x

    result = solve(scene.y, masks, prior=spoiled, scene="full")
    assert result.status is Status.NOT_FINITE
    assert np.isfinite(result.x).all()


@pytest.mark.parametrize("factor", [1e3, -1e3])
def test_a_decoder_whose_estimate_is_beyond_all_use(scene, factor, monkeypatch):
    """The solver begins without it and says so; decode says so too."""
    monkeypatch.setitem(
        registry._registered["decoders"], "wild", lambda: lambda problem, scene: np.full(problem.op.shape, factor)
    )
    result = solve(scene.y, scene.masks, init="wild", iterations=5, reference=scene.truth)
    assert result.status.ok
    assert "'wild' makes of y leaves" in result.remarks[0]
    assert result.history[-1].residual == pytest.approx(residual_of(result.x, scene), rel=1e-3)
    assert "do not trust it" in pnp_sci.decode(scene.y, scene.masks, model="wild").remarks[0]


def test_of_no_light_no_decoder_is_said_to_explode(scene, monkeypatch):
    monkeypatch.setitem(
        registry._registered["decoders"], "wild", lambda: lambda problem, scene: np.full(problem.op.shape, 1e-9)
    )
    assert not any("do not trust it" in remark for remark in pnp_sci.decode(0 * scene.y, scene.masks, "wild").remarks)
