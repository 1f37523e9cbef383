"""Consecutive measurements solved as one video: better than apart, wherever windows lie, with one entry for each."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Result, solve
from pnp_sci.errors import InputError
from pnp_sci.pipeline.sequence import windows

COUNT, FRAMES = 4, 6


@pytest.fixture(scope="module")
def film():
    """A picture that pans, (1, N * B, H, W) in [0, 1]; the masks; and N measurements."""
    from skimage.data import camera

    picture = camera().astype(np.float32) / 255
    frames = [picture[100:228:2, 100 + 2 * k : 228 + 2 * k : 2] for k in range(COUNT * FRAMES)]
    masks = pnp_sci.random_masks((1, FRAMES, 64, 64), seed=1)
    videos = np.stack(frames).reshape(COUNT, 1, FRAMES, 64, 64)
    return videos, masks, np.stack([pnp_sci.simulate(video, masks) for video in videos])


def mean_psnr(x, truth):
    return np.mean([pnp_sci.psnr(a, b) for a, b in zip(x, truth)])


def change_at_boundaries(x):
    """Change from frame to frame where measurements meet, over that within them."""
    change = np.abs(np.diff(x.reshape(-1, *x.shape[-2:]), axis=0)).mean((1, 2))
    meets = np.arange(len(change)) % FRAMES == FRAMES - 1
    return change[meets].mean() / change[~meets].mean()


def test_it_is_better_than_apart(film):
    truth, masks, y = film
    options = {"prior": "flow", "iterations": 75, "scene": "full"}
    apart, together = solve(y, masks, **options), solve(y, masks, **options, sequence=True)
    assert together.x.shape == apart.x.shape
    assert mean_psnr(together.x, truth) > mean_psnr(apart.x, truth) + 0.3
    assert abs(change_at_boundaries(together.x) - 1) < abs(change_at_boundaries(apart.x) - 1)


def test_it_does_not_depend_on_the_windows(film):
    truth, masks, y = film
    whole, parts = (solve(y, masks, iterations=60, sequence=n) for n in (True, 3))
    assert mean_psnr(whole.x, truth) == pytest.approx(mean_psnr(parts.x, truth), abs=0.05)
    assert "window 2: gap" in str(parts)


@pytest.mark.parametrize("most", [3, 4, 7])
@pytest.mark.parametrize("count", [1, 2, 3, 5, 12])
def test_every_measurement_is_kept_once(count, most):
    found = list(windows(count, most))
    assert [n for window in found for n in window.kept] == list(range(count))
    for window in found:
        assert len(window.seen) <= most
        assert set(window.kept) <= set(window.seen)
        for n in window.kept:  # neighbours are seen
            assert {max(n - 1, 0), min(n + 1, count - 1)} <= set(window.seen)


def test_each_has_an_entry(film, tmp_path):
    truth, masks, y = film
    result = solve(y, masks, iterations=5, sequence=3, reference=truth, uncertainty=True)
    assert len(result.scenes) == len(result.settings["noise"]) == COUNT
    assert len(result.settings["plan"]) == len({record.measurement for record in result.history}) == 2
    assert len(set(result.settings["noise"])) == len(set(result.settings["unit"])) == 1
    assert np.isfinite(result.uncertainty).all()
    result.save(tmp_path / "film.npz")
    np.testing.assert_array_equal(Result.load(tmp_path / "film.npz").x, result.x)


def test_one_measurement_is_a_sequence_of_one(film):
    _, masks, y = film
    np.testing.assert_array_equal(
        solve(y[:1], masks, iterations=5, sequence=True).x, solve(y[:1], masks, iterations=5).x
    )


def test_each_may_have_masks_of_its_own(film):
    """Apart and together, they are as if given one by one."""
    truth, masks, _ = film
    own = np.stack([np.roll(masks, n, axis=1) for n in range(COUNT)])
    y = np.stack([pnp_sci.simulate(video, m) for video, m in zip(truth, own)])
    apart = solve(y, own, iterations=20, scene="full")
    for n in range(COUNT):
        np.testing.assert_array_equal(apart.x[n], solve(y[n], own[n], iterations=20, scene="full").x)
    assert mean_psnr(solve(y, own, iterations=40, sequence=True).x, truth) > mean_psnr(apart.x, truth)
    assert all(fit.ok for fit in pnp_sci.check_fit(y, own))
    with pytest.raises(InputError, match="as many such sets as there are measurements"):
        solve(y[:2], own)
    with pytest.raises(InputError, match="register needs masks"):
        solve(y, own, register=True)


def test_each_may_have_a_first_estimate_of_its_own(film):
    truth, masks, y = film
    for sequence in (False, True, 3):
        kept = solve(y, masks, "none", init=truth, iterations=1, sequence=sequence)
        np.testing.assert_allclose(kept.x, truth, atol=1e-3)
    with pytest.raises(InputError, match=r"init has shape \(3, 1, 6, 64, 64\): one video, or 4"):
        solve(y, masks, init=truth[:3])
    with pytest.raises(InputError, match="one video, or 1"):
        solve(y[0], masks, init=truth)


def test_a_still_film_has_one_frame_a_measurement():
    scene = pnp_sci.datasets.embedded_scene(64)
    still = np.repeat(scene.truth[:, :1], scene.masks.shape[1], 1)
    y = np.stack([pnp_sci.simulate(still, scene.masks)] * 3)
    result = solve(y, scene.masks, sequence=True)
    assert all(found["frames_modelled"] == 2 for found in result.scenes)
    y[2] = scene.y  # the last one moves
    result = solve(y, scene.masks, sequence=True)
    assert all(found["frames_modelled"] == found["frames"] for found in result.scenes)


def test_bad_pixels_saturation_and_stops(film):
    truth, masks, y = film
    bad = np.zeros(y.shape, bool)
    bad[1, 3:6, 4] = bad[2, 7, 8] = True
    sensor = pnp_sci.Sensor(noise := 0.01, full_scale=float(np.quantile(y, 0.99)))
    y = np.minimum(y + noise * np.random.default_rng(0).standard_normal(y.shape), sensor.full_scale)
    result = solve(np.ma.array(y, mask=bad), masks, noise=sensor, iterations=30, sequence=True, reference=truth)
    assert [scene["bad"] for scene in result.scenes] == [0, 3, 1, 0]
    assert mean_psnr(result.x, truth) > 20
    stopped = solve(y, masks, sequence=3, iterations=5, callback=lambda state: True)
    assert stopped.status is pnp_sci.Status.STOPPED
    assert len(stopped.scenes) == COUNT


@pytest.mark.parametrize("value", [2, 0, "yes", 3.5])
def test_errors_name_the_argument(film, value):
    _, masks, y = film
    with pytest.raises(InputError, match="sequence is"):
        solve(y, masks, sequence=value)
    with pytest.raises(InputError, match=r"sequence is True, but y has shape \(64, 64\)"):
        solve(y[0], masks, sequence=True)
