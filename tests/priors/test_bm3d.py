"""Block matching and 3-D filtering: its parts against brute force, and what it is worth."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dctn
from skimage import data
from skimage.restoration import denoise_nl_means

import pnp_sci
from pnp_sci import denoise, psnr
from pnp_sci.errors import InputError
from pnp_sci.plugins.combine import InTurn, turns
from priors import bm3d
from priors.bm3d import BM3D, filtered, groups
from priors.flow import Flow
from priors.kernels import bm3d as kernels
from priors.kernels.patches import spread
from priors.tv import TV

SIDE, STEP, REACH = kernels.SIDE, kernels.STEP, kernels.REACH


def picture(rows=64, columns=64):
    """A part of a photograph, float32 (rows, columns)."""
    return data.camera()[100 : 100 + rows, 200 : 200 + columns].astype(np.float32) / 255


@pytest.mark.parametrize(("rows", "columns"), [(5, 3), (7, 40), (2, 2)])
def test_pictures_smaller_than_a_patch_are_left_to_tv(rows, columns):
    x = np.random.default_rng(0).random((1, 2, rows, columns), np.float32)
    by_bm3d, tv = (prior.begin(x.shape, x.dtype) for prior in (BM3D(), TV()))
    for _ in range(4):
        np.testing.assert_array_equal(by_bm3d(x, 0.1), tv(x, 0.1))
    assert not BM3D().traits(x.shape).average


def noisy(x, sigma):
    return (x + sigma * np.random.default_rng(0).standard_normal(x.shape)).astype(np.float32)


def haar(size):
    """The orthonormal Haar transform, (size, size), by its definition."""
    if size == 1:
        return np.ones((1, 1))
    coarse, fine = np.kron(haar(size // 2), [1, 1]), np.kron(np.eye(size // 2), [1, -1])
    return np.concatenate([coarse, fine]) / np.sqrt(2)


def test_the_transform_of_a_group():
    """Cosines along both axes of its patches, which change places, Haar waves across them; the inverse leads back."""
    frame, places = np.random.default_rng(0).random((24, 32), np.float32), np.array([0, 3, 8, 24, 65, 99, 300, 536])
    group = np.stack([frame[p // 32 :, p % 32 :][:SIDE, :SIDE] for p in places])
    cube = np.empty(group.size, np.float32)
    kernels._spectrum(frame.reshape(-1), 32, places, cube)
    planes = dctn(group, norm="ortho", axes=(1, 2)).transpose(0, 2, 1)
    np.testing.assert_allclose(cube.reshape(SIDE, -1), haar(SIDE) @ planes.reshape(SIDE, -1), atol=1e-5)
    kernels._unspectrum(cube)
    np.testing.assert_allclose(cube.reshape(group.shape), group, atol=1e-5)


def test_windows_of_weights():
    """What weights of patches come to in each pixel, against windows added one by one."""
    weights = np.zeros((13, 17), np.float32)
    weights[: -SIDE + 1, : -SIDE + 1] = np.random.default_rng(0).random((6, 10))
    expected = np.zeros(weights.shape)
    for r, c in np.argwhere(weights):
        expected[r : r + SIDE, c : c + SIDE] += weights[r, c] * kernels.WINDOW.reshape(SIDE, SIDE)
    out = np.full_like(weights, np.nan)
    spread(weights, kernels.EDGE, out)
    np.testing.assert_allclose(out, expected, rtol=1e-5)


@pytest.mark.parametrize("shape", [(8, 8), (8, 12), (24, 20), (76, 40)], ids=str)
def test_the_nearest_patches_are_found(shape):
    """Every group holds the patch itself and those at the smallest distances that brute force finds."""
    frame = np.random.default_rng(0).random(shape, np.float32)
    found = groups(frame[None])[0]
    patches = np.lib.stride_tricks.sliding_window_view(frame, (SIDE, SIDE))
    for r, c in np.ndindex(found.shape[:2]):
        top, left = STEP * r, STEP * c
        here = patches[top, left]
        near = patches[max(top - REACH, 0) : top + REACH + 1, max(left - REACH, 0) : left + REACH + 1]
        expected = np.sort(np.sum((near - here) ** 2, axis=(2, 3)), axis=None)[:SIDE]
        at = np.unravel_index(found[r, c], shape)
        distances = np.sum((patches[at] - here) ** 2, axis=(1, 2))
        assert found[r, c, 0] == top * shape[1] + left
        np.testing.assert_allclose(distances[: len(expected)], expected, rtol=1e-4, atol=1e-5)
        assert not distances[len(expected) :].any()


def test_nothing_is_lost_where_nothing_is_shrunk():
    frames = np.stack([picture(44, 64), picture(44, 64)[::-1]])
    found = groups(frames)
    np.testing.assert_allclose(filtered(frames, 0.0, found), frames, atol=2e-6)
    np.testing.assert_allclose(filtered(frames, 1e-6, found, frames), frames, atol=1e-5)


@pytest.mark.parametrize("sigma", [0.05, 0.1])
def test_better_than_non_local_means_and_total_variation(sigma):
    clean = picture(128, 128)
    seen = noisy(clean, sigma)
    by_groups = denoise(seen[None, None], sigma, BM3D())[0, 0]
    by_means = denoise_nl_means(seen, h=0.8 * sigma, sigma=sigma, patch_size=5, patch_distance=6)
    tvs = (denoise(seen[None, None], sigma, TV(strength, inner=200)) for strength in (0.5, 0.7, 1.0))
    by_tv = max(psnr(x[0, 0], clean) for x in tvs)
    assert psnr(by_groups, clean) > max(psnr(by_means, clean), by_tv) + 0.5


def test_the_signal_is_that_of_the_last_call(monkeypatch):
    """The first call thresholds and then filters; the others filter more, by new groups in every so many-th call."""
    monkeypatch.setattr(bm3d, "TUNED", replace(bm3d.TUNED, strength=1.5, renew=3))
    seen = noisy(picture(), 0.1)[None, None]
    session = BM3D().begin(seen.shape, seen.dtype)
    signal = filtered(seen[0], 0.1, groups(seen[0]))
    for n in range(5):
        if n % 3 == 0:
            found = groups(signal)
        signal = filtered(seen[0], 0.1 * (1.5 if n else 1), found, signal)
        assert np.array_equal(session(seen, 0.1)[0], signal)


def told(seen, level):
    """Denoised by a first call that is told the noise of each pixel."""
    return BM3D().begin(seen.shape, seen.dtype)(seen, level)


def test_noise_of_each_pixel():
    """Told of noise that grows across the frame, better than with any one level; told the same everywhere, the same."""
    clean = np.stack([picture(97, 130)] * 2)[None]
    across = np.broadcast_to(np.linspace(0.02, 0.3, 130, dtype=np.float32), clean.shape[2:])
    level = np.stack([across, across[:, ::-1]])[None]
    seen = clean + level * np.random.default_rng(0).standard_normal(clean.shape, np.float32)
    one_level = max(psnr(denoise(seen, one, BM3D()), clean) for one in (0.05, 0.1, 0.15, 0.2))
    assert psnr(told(seen, level), clean) > 0.5 + one_level
    np.testing.assert_allclose(told(seen, np.full_like(seen, 0.1)), denoise(seen, 0.1, BM3D()), atol=1e-6)
    partly = told(seen, np.where(level > 0.1, level, 0))
    assert np.isfinite(partly).all()
    untouched = np.s_[0, 0, :, :20]
    assert np.abs(partly - seen)[untouched].max() < 0.05 * np.abs(partly - seen).max(), "no noise there: nothing to do"


def test_noise_of_one_frame_is_nothing_to_another():
    seen = noisy(np.stack([picture(), picture()]), 0.1)[:, None]
    level = np.full(seen.shape, 0.1, np.float32)
    louder = level * np.array([1, 1e4], np.float32).reshape(2, 1, 1, 1)
    louder[1, ..., :20] = 1e-5
    np.testing.assert_array_equal(told(seen, louder)[0], told(seen, level)[0])


def test_follows_the_scale():
    seen = noisy(picture(33, 45), 0.1)[None, None]
    np.testing.assert_allclose(denoise(8 * seen, 0.8, BM3D()), 8 * denoise(seen, 0.1, BM3D()), rtol=1e-6)


def test_frames_do_not_mix():
    seen = noisy(np.stack([picture(), picture()[::-1]]), 0.1)
    together = denoise(seen[None], 0.1, BM3D())[0]
    for frame, of_both in zip(seen, together):
        assert np.array_equal(denoise(frame[None, None], 0.1, BM3D())[0, 0], of_both)


def test_tv_comes_first():
    seen = noisy(picture(), 0.1)[None, None]
    late = InTurn(turns(BM3D(first=2), seen.shape), seen.shape, seen.dtype)
    tv, alone = (prior.begin(seen.shape, seen.dtype) for prior in (TV(), BM3D()))
    for session in (tv, tv, alone, alone):
        assert np.array_equal(late(seen, 0.1), session(seen, 0.1))


@pytest.mark.parametrize("first", [-1, 0.5, float("nan")])
def test_an_unfit_first_is_named(first):
    with pytest.raises(InputError, match=rf"first is {first}: a whole number >= 0"):
        BM3D(first)


def test_flow_leaves_clips_of_one_frame_to_it():
    seen = noisy(picture(), 0.1)[None, None]
    flow, alone = (prior.begin(seen.shape, seen.dtype) for prior in (Flow(), BM3D()))
    for _ in range(5):
        assert np.array_equal(flow(seen, 0.1), alone(seen, 0.1))


def test_a_still_scene_gains_from_it():
    scene = pnp_sci.datasets.embedded_scene(128)
    still = np.repeat(scene.truth[:, 4:5], scene.truth.shape[1], axis=1)
    y = pnp_sci.simulate(still, scene.masks)
    by_tv, by_flow = (pnp_sci.solve(y, scene.masks, prior) for prior in ("tv", "flow"))
    assert by_flow.scene["still"]
    assert np.mean(psnr(by_flow.x, still)) > np.mean(psnr(by_tv.x, still)) + 1
