"""What is promised at the extremes; docs/extremes.md has the same rows in words."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Status, datasets, solve
from pnp_sci.errors import InputError


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(48)


def usable(result, shape):
    assert result.x.shape == shape
    assert np.isfinite(result.x).all()
    assert result.status.ok
    return result


@pytest.mark.parametrize("factor", [1e-30, 1e-6, 1e6, 1e30])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_scale_of_y(scene, factor, dtype):
    expected = solve(scene.y.astype(np.float64), scene.masks, iterations=20).x
    x = usable(solve((scene.y * factor).astype(dtype), scene.masks, iterations=20), expected.shape).x
    np.testing.assert_allclose(x.astype(np.float64) / factor, expected, atol=1e-3)


@pytest.mark.parametrize(("dtype", "tiny"), [(np.float32, 1e-44), (np.float64, 1e-320)])
def test_denormal_measurements(scene, dtype, tiny):
    """As many digits as a denormal number has; all are within the largest value."""
    y = np.round(9 * scene.y / scene.y.max()).astype(dtype) * dtype(tiny)
    x = usable(solve(y, scene.masks, iterations=20), scene.masks.shape).x
    assert 0 < np.abs(x).max() <= 2 * y.max()


def test_what_the_type_cannot_hold_is_an_error(scene):
    y = (scene.y / scene.y.max() * 3e38).astype(np.float32)
    with pytest.raises(InputError, match=r"y reaches 3e\+38 and masks 0\.001.*float32.*float64"):
        solve(y, scene.masks * np.float32(1e-3))
    usable(solve(y.astype(np.float64), scene.masks * np.float32(1e-3), iterations=5), scene.masks.shape)


@pytest.mark.parametrize("sign", [1, -1])
def test_an_estimate_beyond_its_type(sign):
    """The largest number there is, not infinity."""
    y = np.full((16, 16), sign * 3.4e38, np.float32)
    result = usable(solve(y, np.ones((1, 1, 16, 16)), lambda x, sigma: 2 * x, iterations=3), (1, 1, 16, 16))
    assert (sign * result.x).max() == np.finfo(np.float32).max


def test_a_given_sigma_whose_rho_vanishes(scene):
    """Pixels that no mask opens stay finite where rho is smaller than float32 can tell from 0."""
    masks = scene.masks.copy()
    masks[:, :, 10:14, 10:14] = 0
    usable(solve(scene.y, masks, noise=1e-15, sigma=1e30, iterations=5), masks.shape)


def test_masks_whose_square_is_denormal(scene):
    masks = scene.masks.astype(np.float32)
    masks[:, :, 10:14, 10:14] *= np.float32(1e-20)
    y = pnp_sci.SensingOperator(masks).forward(scene.truth)
    usable(solve(y, masks, iterations=10), masks.shape)


def test_noise_that_is_all_there_is(scene):
    """A given noise far above y leaves a finite estimate."""
    for noise in (1e10, 1e300):
        usable(solve(scene.y, scene.masks, noise=noise, iterations=10), scene.masks.shape)


@pytest.mark.parametrize("value", [0.0, 3.0, -3.0])
@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
def test_constant_measurements(scene, value, algorithm):
    result = solve(np.full_like(scene.y, value), scene.masks, algorithm=algorithm, iterations=20)
    assert np.sign(usable(result, scene.masks.shape).x.mean()) == np.sign(value)


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
@pytest.mark.parametrize(
    "kind", ["zero", "one", "dead in one view", "dead in both", "twice", "thousand", "signed", "sparse"]
)
def test_masks(scene, kind, algorithm):
    masks = scene.masks.astype(np.float32)
    if kind == "zero":
        masks[:] = 0
    elif kind == "one":
        masks[:] = 1
    elif kind == "dead in one view":
        masks[0, :, 10:14, 10:14] = 0
    elif kind == "dead in both":
        masks[:, :, 10:14, 10:14] = 0
    elif kind == "sparse":
        masks *= np.random.default_rng(0).random(masks.shape) < 0.05
    else:
        masks = {"twice": 2 * masks, "thousand": 1000 * masks, "signed": 2 * masks - 1}[kind]
    y = pnp_sci.SensingOperator(masks).forward(scene.truth)
    usable(solve(y, masks, algorithm=algorithm, iterations=40), masks.shape)


def test_identical_masks_are_reported_and_give_a_finite_result(scene, caplog):
    masks = np.stack([scene.masks[0]] * 2)
    assert not pnp_sci.condition(masks).separable
    result = usable(solve(pnp_sci.SensingOperator(masks).forward(scene.truth), masks, iterations=20), masks.shape)
    np.testing.assert_allclose(result.x[0], result.x[1], atol=1e-4)
    assert "cannot be told apart" in caplog.text


def test_closed_masks_are_reported(scene, caplog):
    """One view that is dark is lost, and so is all where both are; separable views raise no warning."""
    solve(scene.y, scene.masks, iterations=1)
    assert not caplog.text
    solve(scene.y, scene.masks * np.array([0, 1]).reshape(2, 1, 1, 1), iterations=1)
    assert "cannot be told apart" in caplog.text
    solve(scene.y, np.zeros_like(scene.masks), iterations=1)
    assert "masks are all 0" in caplog.text


@pytest.mark.parametrize(
    "shape",
    [(1, 1, 16, 16), (2, 64, 16, 16), (2, 10, 1, 40), (2, 10, 40, 1), (1, 1, 1, 1), (4, 3, 17, 13), (2, 10, 1, 1)],
)
@pytest.mark.parametrize("prior", ["tv", "wavelet", "none"])
def test_shapes(shape, prior):
    rng = np.random.default_rng(0)
    masks = rng.random(shape) < 0.5
    y = pnp_sci.SensingOperator(masks).forward(rng.random(shape))
    usable(solve(y, masks, prior, iterations=15), shape)


@pytest.mark.parametrize("dtype", [np.float16, np.uint8, np.uint16, np.int64, bool, ">f8", ">u2"])
def test_input_types(scene, dtype):
    y = np.round(20 * scene.y).astype(dtype)
    result = usable(solve(y, scene.masks.astype(dtype), iterations=20), scene.masks.shape)
    assert result.x.dtype == (np.float64 if np.dtype(dtype) == np.float64 else np.float32)
    if np.dtype(dtype) != bool:
        expected = solve(y.astype(np.float32), scene.masks, iterations=20).x
        np.testing.assert_allclose(result.x, expected, atol=1e-3 * expected.max())


@pytest.mark.parametrize("prior", ["tv", "wavelet", "video"])
@pytest.mark.parametrize("sigma", [0.0, 5e-324, 1e-30, 1e6, 1e30])
@pytest.mark.filterwarnings("error::RuntimeWarning")
def test_sigma(scene, prior, sigma):
    usable(solve(scene.y, scene.masks, prior, sigma=sigma, iterations=10), scene.masks.shape)


def test_ten_thousand_iterations_do_not_drift():
    scene = datasets.embedded_scene(32)
    result = usable(
        solve(scene.y, scene.masks, iterations=10_000, tol=0, noise=0, reference=scene.truth), scene.masks.shape
    )
    assert result.status is Status.ITERATIONS
    psnr = result.history["psnr"]
    assert psnr[-1] > psnr.max() - 0.5
    assert result.history[-1].residual < 1e-3


@pytest.mark.parametrize(("noise", "margin"), [(0.0, 3), (0.1, 2), (0.3, 1), (1.0, -3)])
def test_noise_up_to_the_signal(scene, noise, margin):
    """Better than a uniform picture of the true mean by so many dB, and always better than the first estimate."""
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=noise)
    result = usable(solve(y, scene.masks, reference=scene.truth), scene.masks.shape)
    grey = np.mean(pnp_sci.psnr(np.full_like(scene.truth, scene.truth.mean()), scene.truth))
    psnr = result.history["psnr"]
    assert psnr[-1] > grey + margin
    assert psnr[-1] > psnr[0] + 2
