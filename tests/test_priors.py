"""What every prior promises, whatever it is, and how well the wavelets denoise."""

import numpy as np
import pytest
from conftest import CLASSICAL, PRIORS
from skimage import data
from skimage.restoration import denoise_wavelet

from pnp_sci import psnr
from pnp_sci.errors import InputError
from pnp_sci.plugins.protocols import Denoiser
from priors.tv import TV
from priors.wavelet import Wavelet, shrink

SHAPES = [(1, 1, 1, 1), (2, 3, 5, 7), (1, 9, 16, 16), (3, 2, 1, 12), (1, 4, 12, 1), (2, 1, 33, 18), (2, 3, 34, 33)]


def video(shape=(2, 4, 24, 20), dtype=np.float32):
    return np.random.default_rng(0).random(shape).astype(dtype)


@pytest.fixture(params=PRIORS)
def prior(request):
    return request.param()


@pytest.fixture(params=CLASSICAL)
def classical(request):
    return request.param()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_shape_and_dtype_come_back(prior, shape, dtype):
    x = video(shape, dtype)
    before = x.copy()
    out = prior(x, 0.1)
    assert isinstance(prior, Denoiser)
    assert (out.shape, out.dtype) == (shape, dtype)
    assert np.isfinite(out).all()
    assert np.array_equal(x, before)
    assert not np.shares_memory(out, x)


def test_does_something(prior):
    """Noise around grey becomes weaker."""
    x = np.float32(0.5) + np.float32(0.1) * np.random.default_rng(0).standard_normal((2, 4, 24, 24), np.float32)
    for _ in range(20):
        out = prior(x, 0.1)
    assert out.std() < 0.7 * x.std()


def test_no_noise_is_the_identity(prior):
    x = video()
    assert np.array_equal(prior(x, 0.0), x)
    np.testing.assert_allclose(prior(x, 1e-7), x, atol=3e-6)


@pytest.mark.parametrize("sigma", [10.0, 1e6, 1e30])
def test_huge_noise_gives_finite_values(prior, sigma):
    for _ in range(3):
        out = prior(video(), sigma)
    assert np.isfinite(out).all()


def test_views_do_not_mix(prior):
    """Changing view 2 leaves what a prior does to view 1 untouched, bit for bit, call after call."""
    x = video()
    other = x.copy()
    other[1] = 5 * x[1, ::-1]
    twice = []
    for v in (x, other):
        getattr(prior, "reset", lambda: None)()
        twice.append([prior(v, 0.04) for _ in range(35)][::17])
    for a, b in zip(*twice):
        assert np.array_equal(a[0], b[0])
        assert not np.array_equal(a[1], b[1])


def test_reset_begins_anew(prior):
    runs = []
    for _ in range(2):
        getattr(prior, "reset", lambda: None)()
        runs.append([prior(video(), 0.1) for _ in range(3)])
    assert np.array_equal(*runs)


def test_another_size_begins_anew(classical):
    """A memory that does not fit is forgotten; a denoiser needs no reset for a video of another size or type."""
    for shape, dtype in (((2, 4, 24, 20), "f4"), ((2, 4, 24, 20), "f8"), ((1, 2, 9, 9), "f8"), ((1, 1, 2, 2), "f4")):
        assert classical(video(shape, dtype), 0.1).shape == shape


def test_a_constant_stays(classical):
    x = np.full((2, 4, 17, 20), 0.3, np.float32)
    for _ in range(3):
        np.testing.assert_allclose(classical(x, 0.2), x, atol=2e-6)


def test_values_stay_in_range(classical):
    """Nothing brighter or darker than the input, but for a little ringing."""
    x = video()
    for _ in range(200):
        out = classical(x, 0.1)
    slack = 1e-3 if isinstance(classical, TV) else 0.15
    assert x.min() - slack <= out.min()
    assert out.max() <= x.max() + slack


@pytest.mark.parametrize("dtype", ["uint8", "int64", "float16", ">f4"])
def test_other_dtypes_become_float32(classical, dtype):
    x = (200 * video()).astype(dtype)
    out = classical(x, 5.0)
    classical.reset()
    assert out.dtype == np.float32
    np.testing.assert_array_equal(out, classical(x.astype(np.float32), 5.0))


def test_memory_order_does_not_matter(classical):
    x = video()
    out = classical(x, 0.1)
    classical.reset()
    assert np.array_equal(out, classical(np.asfortranarray(x), 0.1))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda p: p(np.zeros((3, 4, 5)), 0.1), r"x has shape \(3, 4, 5\).*views"),
        (lambda p: p(video(), -0.1), "sigma is -0.1.*>= 0"),
        (lambda p: p(video(), float("nan")), "sigma is nan.*>= 0"),
    ],
)
def test_errors(prior, call, message):
    with pytest.raises(InputError, match=message):
        call(prior)


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
def test_wavelet_options(options, message):
    with pytest.raises(InputError, match=message):
        Wavelet(**options)


def pan():
    """(1, 6, 128, 128): a camera that moves over a photograph, a pixel every other frame."""
    picture = data.camera()[150:278, 100:228] / 255
    return np.stack([np.roll(picture, k // 2, axis=1) for k in range(6)])[None]


@pytest.mark.parametrize("sigma", [0.05, 0.15])
def test_wavelets_denoise_as_well_as_scikit_image(sigma):
    """Averaged over shifts and with its eye on two frames at once, better than BayesShrink frame by frame."""
    x = pan()
    noisy = x + sigma * np.random.default_rng(0).standard_normal(x.shape)
    frames = [denoise_wavelet(f, sigma, "sym4", "soft", 3, method="BayesShrink") for f in noisy[0]]
    reference = float(psnr(np.array(frames), x[0]))
    one, spun = (psnr(Wavelet(strength=1, time=0, shifts=n)(noisy, sigma), x)[0] for n in (1, 8))
    assert one > reference - 0.3
    assert spun > reference + 0.5
    assert psnr(Wavelet(strength=1, shifts=8)(noisy, sigma), x)[0] > spun + 0.3


def test_wavelet_shifts_differ_from_call_to_call():
    denoise = Wavelet()
    assert not np.array_equal(denoise(video(), 0.1), denoise(video(), 0.1))
    assert not np.array_equal(Wavelet(seed=1)(video(), 0.1), Wavelet(seed=2)(video(), 0.1))


def test_flicker_below_the_noise_vanishes():
    """Differences along time are shrunk on every scale in space, their mean over the frame included."""
    x = np.full((1, 6, 32, 32), 0.5)
    x[:, ::2] += 0.005
    out = Wavelet(strength=1)(x, 0.1)
    assert np.ptp(out) < 1e-9
    assert np.ptp(Wavelet(strength=1, time=0)(x, 0.1)) == pytest.approx(0.005)


def test_wavelet_strength_multiplies_sigma():
    assert np.array_equal(Wavelet(strength=2)(video(), 0.1), Wavelet(strength=1)(video(), 0.2))


def test_wavelet_follows_the_scale():
    """D(4 x, 4 sigma) = 4 D(x, sigma), to the bit for a power of two."""
    assert np.array_equal(Wavelet()(4 * video(), 0.4), 4 * Wavelet()(video(), 0.1))


def test_shrink_is_bayes_shrink():
    """The threshold is sigma^2 / sx, frame by frame; a frame of a band that is all noise vanishes."""
    band = np.random.default_rng(0).standard_normal((2, 40, 40)) * np.array([2.0, 0.5])[:, None, None]
    out = shrink(band, 1.0)
    threshold = 1 / np.sqrt(np.mean(band[0] ** 2) - 1)
    np.testing.assert_allclose(out[0], np.sign(band[0]) * np.maximum(np.abs(band[0]) - threshold, 0), atol=1e-12)
    assert not out[1].any()
