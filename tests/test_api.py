"""solve() on whole problems: quality, units, options, errors and the guard."""

import time

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Status, datasets, solve
from pnp_sci.errors import InputError, InputTypeError, UnknownPluginError


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


def test_several_measurements(scene):
    other = pnp_sci.simulate(scene.truth[:, ::-1], scene.masks)
    both = solve(np.stack([scene.y, other]), scene.masks, iterations=10, reference=np.stack([scene.truth] * 2))
    alone = solve(other, scene.masks, iterations=10)
    assert both.x.shape == (2, *scene.masks.shape)
    np.testing.assert_array_equal(both.x[1], alone.x)
    assert [r.measurement for r in both.history] == [0] * 11 + [1] * 11


def test_the_algorithms_agree(scene):
    gap = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60).x
    admm = solve(scene.y, scene.masks, noise=0, tol=0, iterations=60, algorithm="admm").x
    assert relative(admm, gap) < 0.01
    plain = solve(scene.y, scene.masks, iterations=60, algorithm="plain-gap", reference=scene.truth).history["psnr"]
    assert plain[-1] > plain[0]


def test_time_budget(scene):
    """The call ends in time with a status that says so; 10 ** 6 iterations would not."""
    begin = time.perf_counter()
    result = solve(scene.y, scene.masks, iterations=10**6, tol=0, time_budget=0.3)
    assert time.perf_counter() - begin < 3
    assert result.status is Status.TIME_BUDGET
    assert np.isfinite(result.x).all()


def test_plateau_stops_the_solver(scene):
    result = solve(scene.y, scene.masks, tol=0.02)
    assert result.status is Status.CONVERGED
    assert len(result.history) < 60


def test_callback_stops_and_sees_every_state(scene):
    seen = []
    result = solve(scene.y, scene.masks, callback=lambda s: seen.append(s.iteration) or s.iteration == 5)
    assert result.status is Status.STOPPED
    assert seen == [0, 1, 2, 3, 4, 5]


def test_iterates_stay_as_they_were(scene):
    op = pnp_sci.SensingOperator(scene.masks)
    states, copies = [], []
    for state in pnp_sci.iterate(op, scene.y, pnp_sci.make_prior("tv"), np.zeros(op.shape, np.float32)):
        states.append(state.x)
        copies.append(state.x.copy())
        if state.iteration == 4:
            break
    for x, copy in zip(states, copies):
        np.testing.assert_array_equal(x, copy)


def test_a_diverging_prior_is_caught(scene):
    result = solve(scene.y, scene.masks, prior=lambda x, sigma: 3 * x, iterations=200)
    assert result.status is Status.DIVERGED
    assert np.isfinite(result.x).all()
    with pytest.raises(pnp_sci.errors.SolverError):
        result.raise_for_status()


def test_a_prior_that_returns_nan_is_caught(scene):
    def spoiled(x, sigma):
        spoiled.calls += 1
        return x * np.nan if spoiled.calls > 3 else x.copy()

    spoiled.calls = 0
    result = solve(scene.y, scene.masks, prior=spoiled)
    assert result.status is Status.NOT_FINITE
    assert np.isfinite(result.x).all()
    assert result.x.any()


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


def test_stages_and_joint(scene):
    staged = solve(scene.y, scene.masks, prior=[("tv", 10), ("wavelet", 5)], tol=0)
    assert len(staged.history) == 16
    joint = solve(scene.y, scene.masks, prior="tv+wavelet", iterations=15, reference=scene.truth)
    assert joint.history["psnr"][-1] > joint.history["psnr"][0] + 2


def test_torch_module_as_prior(scene):
    torch = pytest.importorskip("torch")

    class Blur(torch.nn.Module):
        def forward(self, x, sigma):
            return torch.nn.functional.avg_pool2d(x, 3, 1, 1, count_include_pad=False)

    result = solve(scene.y, scene.masks, prior=Blur(), iterations=10, algorithm="plain-gap", reference=scene.truth)
    assert result.history["psnr"][-1] > result.history["psnr"][0]


def test_noise_is_regularised(scene):
    """With noise the limit does not fit y, and is better for it than one that does."""
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=0.1)
    aware = solve(y, scene.masks, reference=scene.truth)
    fitted = solve(y, scene.masks, noise=0, reference=scene.truth)
    assert aware.history["psnr"][-1] > fitted.history["psnr"][-1] + 1.5
    assert aware.history[-1].residual > 3 * fitted.history[-1].residual
    assert aware.settings["noise"][0] == pytest.approx(0.1 * scene.y.max(), rel=0.25)


def test_the_start_of_a_uniform_scene_is_the_scene():
    masks = pnp_sci.random_masks((2, 4, 32, 32))
    y = pnp_sci.SensingOperator(masks).forward(np.full(masks.shape, 0.5))
    result = solve(y, masks, iterations=30)
    assert np.abs(result.x - 0.5).max() < 0.02


def test_init_and_reference_in_users_units(scene):
    y, counts = 255 * scene.y, np.round(255 * scene.truth).astype(np.uint8)
    result = solve(y, scene.masks, "none", 255 * scene.truth, iterations=1)
    assert relative(result.x, 255 * scene.truth) < 1e-5
    result = solve(y, scene.masks, "none", counts, iterations=1, reference=counts)
    assert result.history["psnr"][0] > 50


def test_settings_reproduce(scene):
    result = solve(scene.y, scene.masks, prior="tv", iterations=5, strength=0.5)
    s = result.settings
    again = solve(scene.y, scene.masks, s["prior"], s["init"], algorithm=s["algorithm"], iterations=s["iterations"],
                  noise=s["noise"][0], tol=s["tol"], seed=s["seed"], **s["prior_options"])  # fmt: skip
    assert relative(again.x, result.x) < 1e-5
    assert again.settings["y"] == s["y"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"y": np.ones((63, 64))}, "masks has 2 x 10 frames of 64 x 64, but y is 63 x 64"),
        ({"y": np.ones(5)}, "y has shape"),
        ({"y": np.array([["a"]])}, "y has dtype"),
        ({"masks": np.ones((2, 2))}, "masks has shape"),
        ({"prior": "no such"}, "prior is 'no such'.*tv.*wavelet"),
        ({"prior": 3}, "prior is 3"),
        ({"init": "no such"}, "init is 'no such'"),
        ({"init": np.ones((1, 2))}, "init gives"),
        ({"algorithm": "no such"}, "algorithm is 'no such'.*gap.*admm"),
        ({"noise": -1}, "noise is -1"),
        ({"noise": "loud"}, "noise is 'loud'"),
        ({"iterations": 0}, "iterations is 0"),
        ({"tol": -1}, "tol is -1"),
        ({"tol": float("nan")}, "tol is nan"),
        ({"no_option": 3}, "takes no option no_option"),
        ({"strength": -1.0}, "strength is -1"),
        ({"reference": np.ones(3)}, "reference has shape"),
    ],
)
def test_errors_name_the_argument(scene, change, message):
    arguments = {"y": scene.y, "masks": scene.masks, **change}
    with pytest.raises((InputError, InputTypeError, UnknownPluginError), match=message):
        solve(**arguments)


def test_non_finite_input_is_counted(scene):
    y = scene.y.copy()
    y[3, 4] = y[5, 6] = np.nan
    with pytest.raises(InputError, match=r"y has 2 values .* first at index \(3, 4\)"):
        solve(y, scene.masks)
    masks = scene.masks.astype(np.float32)
    masks[1, 2, 3, 4] = np.inf
    with pytest.raises(InputError, match=r"masks has 1 values .* \(1, 2, 3, 4\)"):
        solve(scene.y, masks)
