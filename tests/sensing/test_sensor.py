import logging

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci.bench import Method, Source, compare
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.noise import estimate_noise
from pnp_sci.sensing.sensor import Sensor


@pytest.fixture(scope="module")
def scene():
    return pnp_sci.datasets.embedded_scene(64)


@pytest.fixture(scope="module")
def camera(scene):
    return Sensor(read_noise=0.0, full_scale=0.6 * float(scene.y.max()))


def quality(x, scene):
    return float(np.mean(pnp_sci.psnr(x, scene.truth)))


@pytest.mark.parametrize("light", [0.5, 20, 1e4])
def test_an_exposure_has_the_variance_that_the_sensor_states(light):
    camera = Sensor(read_noise=2.0, gain=0.5, full_scale=1e5, bits=16)
    clean = np.full((300, 300), light)
    y = np.concatenate([camera.expose(clean + 50, seed) for seed in range(3)])
    assert y.mean() == pytest.approx(light + 50, abs=5 * y.std() / np.sqrt(y.size))
    assert y.std() == pytest.approx(float(np.mean(camera.deviation(y))), rel=0.02)


def test_photon_noise_is_that_of_whole_electrons():
    y = Sensor(read_noise=0.0, gain=0.25).expose(np.full((50, 50), 1.0))
    assert np.array_equal(y / 0.25, np.round(y / 0.25))
    bright = Sensor(read_noise=0.0, gain=1e-12).expose(np.full((50, 50), 1.0))
    assert bright.std() == pytest.approx(1e-6, rel=0.1)


@given(st.floats(0.01, 1e6), st.integers(1, 16), st.integers(0, 5))
def test_levels_end_at_full_scale_and_are_saturated_there(full_scale, bits, seed):
    camera = Sensor(0.1 * full_scale, full_scale=full_scale, bits=bits)
    clean = np.linspace(-0.2, 1.5, 90).reshape(9, 10) * full_scale
    y = camera.expose(clean, seed)
    levels = y / full_scale * (2**bits - 1)
    assert levels == pytest.approx(np.round(levels), abs=1e-6)
    assert y.min() >= 0
    saturated = camera.saturated(y)
    assert saturated is not None
    assert np.array_equal(saturated, np.isclose(y, full_scale, rtol=1e-6))


def test_grey_levels_begin_below_a_black_level_that_was_subtracted():
    raw, y = (Sensor(3.0, full_scale=255 - black, bits=8, black_level=black) for black in (0.0, 20.0))
    clean = np.linspace(0, 300, 90).reshape(9, 10)
    assert raw.step == y.step == 1
    np.testing.assert_array_equal(y.expose(clean) + 20, raw.expose(clean + 20))


def test_nothing_is_saturated_without_a_full_scale():
    assert Sensor(0.1).saturated(np.ones((4, 4))) is None
    assert Sensor(0.1, full_scale=2).saturated(np.ones((4, 4))) is None


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"read_noise": -1}, r"read_noise is -1.*>= 0"),
        ({"read_noise": "some"}, "read_noise is 'some'"),
        ({"read_noise": 1, "gain": np.nan}, "gain is nan"),
        ({"gain": 1}, r"read_noise is .auto.*beside a gain"),
        ({"full_scale": 0}, r"full_scale is 0.*> 0"),
        ({"full_scale": 1, "bits": 0}, r"bits is 0.*>= 1"),
        ({"full_scale": 1, "bits": 33}, r"bits is 33.*1 to 32"),
        ({"full_scale": 1, "bits": 8.0}, r"bits is 8.0.*whole number"),
        ({"bits": 8}, "bits is 8, but full_scale is None"),
    ],
)
def test_what_no_camera_is(fields, message):
    with pytest.raises(InputError, match=message):
        Sensor(**fields)


def test_what_cannot_be_exposed():
    with pytest.raises(InputError, match=r"auto.*a number was expected"):
        Sensor().expose(np.ones((2, 2)))
    with pytest.raises(InputError, match=r"reaches -1.*>= 0 was expected"):
        Sensor(0.0, gain=1.0).expose(-np.ones((2, 2)))
    with pytest.raises(InputError, match=r"bits is 8.*beside a Sensor"):
        pnp_sci.simulate(np.ones((1, 2, 4, 4)), np.ones((1, 2, 4, 4)), Sensor(0.1), bits=8)


def test_simulate_exposes(scene):
    camera = Sensor(0.01, 0.001, 3.0, 10)
    assert np.array_equal(pnp_sci.simulate(scene.truth, scene.masks, camera, seed=3), camera.expose(scene.y, 3))


@pytest.mark.parametrize(("algorithm", "gain"), [("gap", 0.7), ("plain-gap", 0.2), ("admm", 0.7)])
def test_saturated_pixels_are_bounds(scene, camera, algorithm, gain):
    y = pnp_sci.simulate(scene.truth, scene.masks, camera)
    settings = {"algorithm": algorithm, "iterations": 60, "tol": 0}
    as_values = pnp_sci.solve(y, scene.masks, noise=0.0, **settings)
    as_bounds = pnp_sci.solve(y, scene.masks, noise=camera, **settings)
    assert quality(as_bounds.x, scene) > quality(as_values.x, scene) + gain
    saturated = camera.saturated(y)
    assert as_bounds.scene["saturated"] == saturated.sum() > 0.02 * y.size
    excess = (pnp_sci.SensingOperator(scene.masks).forward(as_bounds.x) - y)[saturated] / y.max()
    assert np.mean(excess > -0.1) > 0.95  # there may have been more light
    assert np.max(excess) > 0.1  # and there was


def test_accelerated_gap_and_admm_come_to_the_same_end_with_bounds(scene, camera):
    y = pnp_sci.simulate(scene.truth, scene.masks, camera)
    settings = {"noise": camera, "iterations": 600, "tol": 0, "time": 0.0, "inner": 3}
    gap, admm = (pnp_sci.solve(y, scene.masks, algorithm=a, **settings).x for a in ("gap", "admm"))
    assert np.sqrt(np.mean((gap - admm) ** 2)) < 0.01


def test_a_pixel_that_is_noisier_counts_less(scene):
    deviation = np.where(np.arange(64)[:, None] < 32, 0.1, 1.0) * np.ones_like(scene.y)
    y = scene.y + (deviation * np.random.default_rng(0).standard_normal(scene.y.shape)).astype(scene.y.dtype)
    op = pnp_sci.SensingOperator(scene.masks)

    def clean_half(noise):
        start = np.full(op.shape, 0.5, np.float32)
        for state in pnp_sci.iterate(op, y, "tv", start, noise=noise):
            if state.iteration == 60:
                return np.mean((state.x - scene.truth)[:, :, :32] ** 2)

    assert clean_half(deviation) < 0.85 * clean_half(float(np.sqrt(np.mean(deviation**2))))


def test_the_unit_of_y_does_not_matter(scene):
    camera, thousand = Sensor(0.05, 0.002, 4.0, 8), Sensor(50, 2, 4000.0, 8)
    y = pnp_sci.simulate(scene.truth, scene.masks, camera)
    one, other = (pnp_sci.solve(a * y, scene.masks, noise=n, iterations=20) for a, n in ((1, camera), (1000, thousand)))
    assert other.x / 1000 == pytest.approx(one.x, abs=1e-3)


def test_noise_of_grey_levels_is_counted_once():
    big = pnp_sci.datasets.embedded_scene(256)
    y = Sensor(0.2, full_scale=10.0, bits=4).expose(big.y)
    total = [
        pnp_sci.solve(y, big.masks, noise=Sensor(full_scale=10.0, bits=bits), iterations=1).settings["noise"][0]
        for bits in (None, 4)
    ]
    assert total[1] == pytest.approx(total[0], rel=1e-3)


def test_few_photons_are_not_trusted_more_for_being_few():
    big = pnp_sci.datasets.embedded_scene(128)
    camera = Sensor(read_noise=0.1 * float(big.y.max()) / 20, gain=float(big.y.max()) / 20)
    y = camera.expose(big.y)
    told, one_number = (
        pnp_sci.solve(y, big.masks, noise=n) for n in (camera, float(np.sqrt(np.mean(camera.deviation(big.y) ** 2))))
    )
    assert quality(told.x, big) > quality(one_number.x, big)
    assert told.x.mean() == pytest.approx(big.truth.mean(), rel=0.12)


def test_read_noise_is_estimated_beside_saturated_pixels():
    big = pnp_sci.datasets.embedded_scene(256)
    camera = Sensor(0.3, full_scale=0.6 * float(big.y.max()))
    y = camera.expose(big.y)
    op = pnp_sci.SensingOperator(big.masks)
    assert estimate_noise(op, y, camera.saturated(y)) == pytest.approx(0.3, rel=0.2)
    result = pnp_sci.solve(y, big.masks, noise=Sensor(full_scale=camera.full_scale), iterations=2)
    assert result.settings["noise"][0] == pytest.approx(0.3, rel=0.2)
    assert estimate_noise(op, y, np.ones(y.shape, bool)) == 0


def test_a_result_tells_the_camera(scene, tmp_path):
    camera = Sensor(0.05, 0.002, 4.0, 8)
    result = pnp_sci.solve(scene.y, scene.masks, noise=camera, iterations=2)
    assert Sensor(np.float32(0.5), np.float32(2), np.float32(255), np.uint8(16)).step == 255 / (2**16 - 1)
    result.save(tmp_path / "result.npz")
    assert Sensor(**pnp_sci.Result.load(tmp_path / "result.npz").settings["sensor"]) == camera
    known = camera.deviation(scene.y)[~camera.saturated(scene.y)]
    assert result.settings["noise"][0] == pytest.approx(np.sqrt(np.mean(known**2)), rel=1e-3)


def test_a_still_scene_is_found_beside_saturated_pixels():
    big = pnp_sci.datasets.embedded_scene(128)
    truth = np.repeat(big.truth[:, :1], big.truth.shape[1], axis=1)
    clean = pnp_sci.simulate(truth, big.masks)
    camera = Sensor(0.0, full_scale=0.8 * float(clean.max()))
    result = pnp_sci.solve(camera.expose(clean), big.masks, noise=camera, iterations=5)
    assert result.scene["still"]
    assert result.scene["saturated"] > 0


@pytest.mark.parametrize("share", [0.6, 0.5])
def test_scenes_are_judged_by_what_is_not_saturated(share):
    """Holes at the saturated pixels of all views at once must make no dark view lit, and no moving scene still."""
    big = pnp_sci.datasets.embedded_scene(128)
    dark = big.truth * np.array([1, 0], np.float32)[:, None, None, None]
    clean = pnp_sci.simulate(dark, big.masks)
    camera = Sensor(0.0, full_scale=share * float(clean.max()))
    model = pnp_sci.solve(camera.expose(clean), big.masks, noise=camera, iterations=1).scene
    assert model["views"] == (True, False)
    assert not model["still"]
    camera = Sensor(0.0, full_scale=share * float(big.y.max()))
    assert not pnp_sci.solve(camera.expose(big.y), big.masks, noise=camera, iterations=1).scene["still"]


@pytest.mark.parametrize("algorithm", ["gap", "plain-gap", "admm"])
@pytest.mark.parametrize("model", [pnp_sci.SceneModel((True, False)), pnp_sci.SceneModel((True, True), (True, False))])
def test_bounds_with_a_given_scene(scene, camera, algorithm, model):
    y = camera.expose(scene.y)
    result = pnp_sci.solve(y, scene.masks, noise=camera, scene=model, algorithm=algorithm, iterations=5)
    assert result.status.ok
    assert result.x[1].any() == model.views[1]


def test_several_measurements_have_their_own_saturated_pixels(scene, camera):
    y = np.stack([camera.expose(scene.y), camera.expose(0.8 * scene.y)])
    together = pnp_sci.solve(y, scene.masks, noise=camera, iterations=5)
    for n in range(2):
        alone = pnp_sci.solve(y[n], scene.masks, noise=camera, iterations=5)
        assert np.array_equal(together.x[n], alone.x)
        assert together.scenes[n] == alone.scene


@pytest.mark.parametrize("wild", [np.inf, np.nan])
def test_a_prior_that_fails_is_caught_where_all_is_saturated(scene, wild):
    ones = np.ones(scene.masks.shape)
    result = pnp_sci.solve(
        np.ones_like(scene.y), ones, lambda x, sigma: x * wild, noise=Sensor(full_scale=1.0), iterations=5
    )
    assert result.status is pnp_sci.Status.NOT_FINITE


def test_everything_saturated_is_a_finite_result(scene):
    result = pnp_sci.solve(np.ones_like(scene.y), scene.masks, noise=Sensor(full_scale=1.0), iterations=5)
    assert np.isfinite(result.x).all()
    assert result.status.ok


def test_a_picture_that_looks_saturated_is_remarked_upon(scene, camera, caplog):
    with caplog.at_level(logging.WARNING, "pnp_sci"):
        pnp_sci.solve(scene.y, scene.masks, iterations=1)
        pnp_sci.solve(camera.expose(scene.y), scene.masks, noise=camera, iterations=1)
        assert not caplog.records
        pnp_sci.solve(camera.expose(scene.y), scene.masks, iterations=1)
        compare(camera.expose(scene.y), scene.masks, [Method("tv", iterations=1), Method("none", iterations=1)])
    hint = f"noise=pnp_sci.Sensor(full_scale={camera.full_scale:.7g})"
    assert [r.message.endswith(hint) for r in caplog.records] == [True, True]


def test_methods_are_compared_with_the_camera_and_say_how_to_repeat_it(scene, tmp_path):
    camera = Sensor(0.05, 0.002, 0.7 * float(scene.y.max()), 8)
    y = pnp_sci.simulate(scene.truth, scene.masks, camera)
    source = Source(tmp_path / "meas.npz", tmp_path / "meas.npz", None, None, None, None)
    trial = compare(y, scene.masks, [Method("tv", iterations=5)], noise=camera, source=source).trials[0]
    assert np.isfinite(trial.score)
    call = trial.python.partition("noise=")[2].rsplit(", seed")[0]
    assert eval(call, {"pnp_sci": pnp_sci}) == camera
    for words in ("--noise 0.05", "--gain 0.002", f"--full-scale {camera.full_scale}", "--bits 8"):
        assert words in trial.command


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"op": np.ones((2, 4, 8, 8))}, "op is ndarray: a SensingOperator"),
        ({"y": np.ones((8, 9))}, r"y has shape \(8, 9\)"),
        ({"y": np.full((8, 8), np.nan)}, "y has 64 values that are NaN"),
        ({"y": np.ma.masked_equal(np.eye(8), 1)}, "y is a masked array"),
        ({"bad": np.ones((9, 9), bool)}, "bad has shape"),
        ({"saturated": np.ones((9, 9), bool)}, "saturated has shape"),
    ],
)
def test_the_estimate_of_noise_names_what_it_cannot_use(change, message):
    arguments = {"op": pnp_sci.SensingOperator(np.ones((2, 4, 8, 8))), "y": np.ones((8, 8)), **change}
    with pytest.raises((InputError, InputTypeError), match=message):
        estimate_noise(**arguments)
