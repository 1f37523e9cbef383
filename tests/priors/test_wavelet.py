"""Wavelets against scikit-image and the formula of their threshold, and what shifts and strength do."""

import numpy as np
import pytest
from skimage import data
from skimage.restoration import denoise_wavelet

from pnp_sci import denoise, psnr, solve
from pnp_sci.errors import InputError
from priors.wavelet import Wavelet, shrink


def video(shape=(2, 4, 24, 20)):
    return np.random.default_rng(0).random(shape, np.float32)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"strength": 0}, "strength is 0.*> 0"),
        ({"wavelet": "morl"}, "wavelet is 'morl'.*sym4"),
        ({"levels": 0}, "levels is 0.*>= 1"),
        ({"time": -1}, "time is -1.*>= 0"),
        ({"time": 0.5}, "time is 0.5.*whole"),
        ({"shifts": 0}, "shifts is 0.*>= 1"),
        ({"seed": -1}, "seed is -1.*>= 0"),
    ],
)
def test_options(options, message):
    with pytest.raises(InputError, match=message):
        Wavelet(**options)


def test_within_the_solver_shifts_average_out():
    """Every pixel of a single frame is measured, so that the video is known."""
    frame = data.camera()[100:164, 200:264] / 255
    for prior in (Wavelet(), Wavelet(wavelet="haar", levels=2)):
        result = solve(frame, np.ones((1, 1, 64, 64)), prior, noise=0)
        assert psnr(result.x[0, 0], frame) > 45


def pan():
    """(1, 6, 128, 128): a camera that moves over a photograph, a pixel every other frame."""
    picture = data.camera()[150:278, 100:228] / 255
    return np.stack([np.roll(picture, k // 2, axis=1) for k in range(6)])[None]


@pytest.mark.parametrize("sigma", [0.05, 0.15])
def test_denoises_as_well_as_scikit_image(sigma):
    """Averaged over shifts and with its eye on two frames at once, better than BayesShrink frame by frame."""
    x = pan()
    noisy = x + sigma * np.random.default_rng(0).standard_normal(x.shape)
    frames = [denoise_wavelet(f, sigma, "sym4", "soft", 3, method="BayesShrink") for f in noisy[0]]
    reference = float(psnr(np.array(frames), x[0]))
    one, spun = (psnr(denoise(noisy, sigma, Wavelet(strength=1, time=0, shifts=n)), x)[0] for n in (1, 8))
    assert one > reference - 0.3
    assert spun > reference + 0.5
    assert psnr(denoise(noisy, sigma, Wavelet(strength=1, shifts=8)), x)[0] > spun + 0.3


def test_shifts_differ_from_call_to_call_and_from_seed_to_seed():
    session = Wavelet().begin(video().shape, np.dtype(np.float32))
    assert not np.array_equal(session(video(), 0.1), session(video(), 0.1))
    assert not np.array_equal(*(denoise(video(), 0.1, Wavelet(seed=seed)) for seed in (1, 2)))


def test_flicker_below_the_noise_vanishes():
    """Differences along time are shrunk on every scale in space, their mean over the frame included."""
    x = np.full((1, 6, 32, 32), 0.5)
    x[:, ::2] += 0.005
    out = denoise(x, 0.1, Wavelet(strength=1))
    assert np.ptp(out) < 1e-9
    assert np.ptp(denoise(x, 0.1, Wavelet(strength=1, time=0))) == pytest.approx(0.005)


def test_strength_multiplies_sigma():
    weak, strong = (denoise(video(), sigma, Wavelet(strength=n)) for n, sigma in ((1, 0.2), (2, 0.1)))
    assert np.array_equal(weak, strong)


def test_follows_the_scale():
    """D(4 x, 4 sigma) = 4 D(x, sigma), to the bit for a power of two."""
    assert np.array_equal(denoise(4 * video(), 0.4, Wavelet()), 4 * denoise(video(), 0.1, Wavelet()))


def test_shrink_is_bayes_shrink():
    """The threshold is sigma^2 / sx, frame by frame; a frame of a band that is all noise vanishes."""
    band = np.random.default_rng(0).standard_normal((2, 40, 40)) * np.array([2.0, 0.5])[:, None, None]
    out = shrink(band, 1.0)
    threshold = 1 / np.sqrt(np.mean(band[0] ** 2) - 1)
    np.testing.assert_allclose(out[0], np.sign(band[0]) * np.maximum(np.abs(band[0]) - threshold, 0), atol=1e-12)
    assert not out[1].any()
