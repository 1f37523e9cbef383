"""solve() on whole problems: quality, units and what a result says of itself."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SceneModel, datasets, solve


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


def relative(a, b):
    return np.linalg.norm(np.asarray(a, float) - np.asarray(b, float)) / np.linalg.norm(np.asarray(b, float))


def test_recovers_the_embedded_scene():
    scene = datasets.embedded_scene(128)
    result = solve(scene.y, scene.masks, reference=scene.truth)
    assert result.x.shape == scene.truth.shape
    assert result.x.dtype == np.float32
    assert result.status.ok
    psnr = result.history["psnr"]
    assert psnr[-1] > psnr[0] + 6
    assert psnr[-1] == pytest.approx(np.mean(pnp_sci.psnr(result.x, scene.truth)), abs=1e-3)
    assert 0.5 < result.history[-1].ssim < 1
    assert result.history[-1].residual < 0.01


@pytest.mark.parametrize("pair", ["bear_blackswan", "car-b_car-w", "hike_hockey"])
def test_benchmark_pairs(pair, data):
    """At least the peers' GAP-TV minus 0.1 dB for every video."""
    peers = {"bear_blackswan": (23.85, 24.24), "car-b_car-w": (21.52, 22.10), "hike_hockey": (22.43, 23.93)}
    scene = datasets.dualview(pair)
    psnr = pnp_sci.psnr(solve(scene.y, scene.masks).x, scene.truth)
    assert (psnr >= np.array(peers[pair]) - 0.1).all(), psnr


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("factor", [1e-6, 1e-3, 255, 1e6])
def test_scale_equivariance(scene, factor, dtype):
    y = scene.y.astype(dtype)
    scaled, plain = (solve(dtype(a) * y, scene.masks).x for a in (factor, 1))
    assert relative(scaled, factor * plain) < 1e-4


@pytest.mark.parametrize("factor", [2.0, 1e3, 0.01])
def test_scaled_masks(scene, factor):
    """Masks times c make a video over c, to rounding: nothing divides by sum(masks)."""
    plain = solve(scene.y, scene.masks.astype(np.float32), iterations=40).x
    assert relative(factor * solve(scene.y, scene.masks * np.float32(factor), iterations=40).x, plain) < 1e-3


def test_view_permutation(scene):
    swapped = solve(scene.y, scene.masks[::-1], iterations=30).x[::-1]
    assert relative(swapped, solve(scene.y, scene.masks, iterations=30).x) < 1e-3


def test_the_algorithms_agree(scene):
    gap = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60).x
    admm = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60, algorithm="admm").x
    assert relative(admm, gap) < 0.01
    plain = solve(scene.y, scene.masks, iterations=60, algorithm="plain-gap", reference=scene.truth).history["psnr"]
    assert plain[-1] > plain[0]


def test_noise_is_regularised(scene):
    """With noise the limit does not fit y, and is better for it than one that does."""
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=0.1)
    aware = solve(y, scene.masks, scene="full", reference=scene.truth)
    fitted = solve(y, scene.masks, scene="full", noise=0, reference=scene.truth)
    assert aware.history["psnr"][-1] > fitted.history["psnr"][-1] + 1.5
    assert aware.history[-1].residual > 3 * fitted.history[-1].residual
    assert aware.settings["noise"][0] == pytest.approx(0.1 * scene.y.max(), rel=0.25)


def test_the_start_of_a_uniform_scene_is_the_scene():
    masks = pnp_sci.random_masks((2, 4, 32, 32))
    y = pnp_sci.SensingOperator(masks).forward(np.full(masks.shape, 0.5))
    result = solve(y, masks, iterations=30)
    assert np.abs(result.x - 0.5).max() < 0.02


def test_a_noisy_still_scene_is_better_than_its_measurement():
    """One view that stands still: y over the sum of its masks shows it as noisy as it came."""
    scene = datasets.embedded_scene(96)
    truth = np.repeat(scene.truth[:1, 4:5], 8, axis=1)
    masks = scene.masks[:1, :8]
    y = pnp_sci.simulate(truth, masks, noise=0.03)
    total = masks[0].sum(0, dtype=np.float32)
    divided = np.divide(y, total, out=np.zeros_like(y), where=total > 0)
    result = solve(y, masks, "tv", scene=SceneModel((True,), still=True))
    assert pnp_sci.psnr(result.x[0, 0], truth[0, 0]) > pnp_sci.psnr(divided, truth[0, 0]) + 5


def test_priors_work_together_and_one_after_the_other(scene):
    staged = solve(scene.y, scene.masks, prior=[("tv", 10), ("wavelet", 5)], tol=0)
    assert len(staged.history) == 16
    joint = solve(scene.y, scene.masks, prior="tv+wavelet", iterations=15, reference=scene.truth)
    assert joint.history["psnr"][-1] > joint.history["psnr"][0] + 2


def test_a_prior_that_has_been_made_may_be_given_again(scene):
    made = pnp_sci.as_prior([("tv", 2), ("wavelet", 1)])
    result = solve(scene.y, scene.masks, prior=made, iterations=3, scene="full")
    named = solve(scene.y, scene.masks, prior=[("tv", 2), ("wavelet", 1)], iterations=3, scene="full")
    np.testing.assert_array_equal(result.x, named.x)
    assert result.settings["prior"].startswith("Stages(")
    assert "TV(" in result.settings["prior"]
    assert named.settings["prior"] == [["tv", 2], ["wavelet", 1]]


def test_underflow_is_no_failure(scene):
    with np.errstate(all="raise"):
        for prior, options in (("tv", {}), ("flow", {"first": 42})):
            assert solve(scene.y, scene.masks, prior, iterations=45, **options).status.ok


def test_settings_reproduce(scene):
    result = solve(scene.y, scene.masks, prior="tv", iterations=5, strength=0.5)
    s = result.settings
    again = solve(scene.y, scene.masks, s["prior"], s["init"], algorithm=s["algorithm"], iterations=s["iterations"],
                  noise=s["noise"][0], tol=s["tol"], seed=s["seed"], **s["prior_options"])  # fmt: skip
    assert relative(again.x, result.x) < 1e-5
    assert again.settings["y"] == s["y"]
    assert again.settings["init"] == s["init"] == "adjoint"
