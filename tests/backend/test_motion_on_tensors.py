"""Motion on tensors: known shifts, and averages that help as those of arrays do."""

import numpy as np
import pytest

from priors.kernels.average import CUBIC, FRACTION
from priors.motion.videos import seen

torch = pytest.importorskip("torch")
from priors.on_device.filters import box, gaussian  # noqa: E402
from priors.on_device.warp import bicubic  # noqa: E402


def moving(frames=6, side=64, speed=1.5):
    """Waves that move along columns by `speed` pixels a frame, (1, B, H, W)."""
    rows, columns = np.mgrid[:side, :side]
    shifts = speed * np.arange(frames)[:, None, None]
    x = 0.5 + 0.2 * np.sin((columns - shifts) / 3) + 0.2 * np.cos(rows / 4 + (columns - shifts) / 9)
    return x[None].astype(np.float32)


def test_filters_are_those_of_scipy():
    ndimage = pytest.importorskip("scipy.ndimage")
    x = np.random.default_rng(0).random((2, 30, 21))
    ours = (box(torch.from_numpy(x), 5, 2), gaussian(torch.from_numpy(x), 1.5))
    twice = ndimage.uniform_filter(ndimage.uniform_filter(x, (1, 5, 5), mode="nearest"), (1, 5, 5), mode="nearest")
    for came, expected in zip(ours, (twice, ndimage.gaussian_filter(x, (0, 1.5, 1.5), mode="nearest"))):
        np.testing.assert_allclose(came, expected, atol=1e-12)


def test_warps_have_the_kernel_of_the_averages():
    x = np.random.default_rng(0).random((1, 12, 15))
    for units in (0, 16, 40, 63):
        flow = torch.zeros(1, 2, 12, 15, dtype=torch.float64)
        flow[:, 0] = units / FRACTION
        came = bicubic(torch.from_numpy(x), flow)[0, :, 5]
        np.testing.assert_allclose(came, x[0, :, 4:8] @ CUBIC[units], atol=1e-6)


def test_the_motion_of_waves_is_found():
    motion = seen(torch.from_numpy(moving()), 3, 0.1, 1.5, 0.01)
    for p, (b, n) in enumerate(motion.pairs.pairs):
        middle = motion.flow[0, p, :, 8:-8, 8:-8].mean((1, 2))
        np.testing.assert_allclose(middle, [0.75 * (n - b), 0], atol=0.1)  # in frames of half the size
    assert motion.at_rest[0] < 0.05


def test_averages_along_the_motion_remove_noise():
    x = moving()
    noisy = x + 0.03 * np.random.default_rng(1).standard_normal(x.shape).astype(np.float32)
    for video in (noisy, torch.from_numpy(noisy)):
        motion = seen(video, 3, 0.08, 1.5, 0.01)
        error = np.asarray(motion.average(video)) - x
        assert error.std() < 0.5 * 0.03
        assert error.std() == pytest.approx(0.03 * float(motion.remaining.mean()), rel=0.15)


def test_what_stands_still_is_found():
    x = np.repeat(moving(1), 5, 1)
    assert seen(torch.from_numpy(x), 3, 0.1, 1.5, 0.03).at_rest[0] > 0.9
