"""Every prior, and every combination of two, keeps the promises of a prior."""

from itertools import combinations, permutations

import numpy as np
import pytest
from operators_and_priors import CLASSICAL, PRIORS, learned

from pnp_sci import as_prior, denoise
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.plugins.combine import Joint, Stages
from pnp_sci.plugins.registry import available
from pnp_sci.testing import check_prior
from priors.bm3d import BM3D
from priors.desci import DeSCI
from priors.flow import Flow
from priors.tv import TV
from priors.video import Video
from priors.wavelet import Wavelet

BY_NAME = {"tv": TV(), "wavelet": Wavelet(), "bm3d": BM3D(first=0), "flow": Flow(first=0), "desci": DeSCI(first=0)}


def video(shape=(2, 4, 24, 20), dtype=np.float32):
    return np.random.default_rng(0).random(shape).astype(dtype)


def begun(prior, x):
    return prior.begin(x.shape, x.dtype)


@pytest.fixture(params=PRIORS)
def prior(request):
    return request.param


@pytest.fixture(params=CLASSICAL)
def classical(request):
    return request.param


def test_priors_keep_their_promises(prior):
    check_prior(prior)


def test_installed_priors_are_among_them():
    given = [parameter.values[0] for parameter in PRIORS]
    assert all(as_prior(name) in given for name in available("priors"))


@pytest.mark.parametrize(("one", "other"), list(combinations(BY_NAME, 2)))
def test_two_at_once_keep_their_promises(one, other):
    check_prior(f"{one}+{other}")
    check_prior(Joint([BY_NAME[other], BY_NAME[one]], shares=[1, 3]))


@pytest.mark.parametrize(("one", "other"), list(permutations(BY_NAME, 2)))
def test_two_stages_keep_their_promises(one, other):
    """One call of the first prior, and those that follow of the second."""
    check_prior(Stages([(BY_NAME[one], 1), (BY_NAME[other], 1)]))


@pytest.mark.parametrize(
    "combined",
    [
        learned("video+tv", name="at once"),
        learned("flow+video", name="flow at once"),
        learned(Stages([(Video(first=0), 1), (TV(), 1)]), name="video, then tv"),
        learned(Stages([(TV(), 1), (Video(), 1)]), name="tv, then video"),
    ],
)
def test_video_with_another_prior_keeps_its_promises(combined):
    check_prior(combined)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 5, 7), (3, 2, 1, 12), (1, 4, 12, 1), (2, 1, 33, 18)], ids=str)
def test_small_and_flat_videos(prior, shape):
    check_prior(prior, [shape])


def test_noise_around_grey_becomes_weaker(prior):
    x = np.float32(0.5) + np.float32(0.1) * np.random.default_rng(0).standard_normal((2, 4, 24, 24), np.float32)
    session = begun(prior, x)
    for _ in range(20):
        out = session(x, 0.1)
    assert out.std() < 0.7 * x.std()


def test_no_noise_is_the_identity(prior):
    x = video()
    session = begun(prior, x)
    assert np.array_equal(session(x, 0.0), x)
    np.testing.assert_allclose(session(x, 1e-7), x, atol=3e-6)


@pytest.mark.parametrize("sigma", [10.0, 1e6, 1e30])
def test_huge_noise_gives_finite_values(prior, sigma):
    session = begun(prior, video())
    for _ in range(3):
        out = session(video(), sigma)
    assert np.isfinite(out).all()


def test_views_do_not_mix(prior):
    """Changing view 2 leaves what a prior does to view 1 untouched, bit for bit, call after call."""
    x = video()
    other = x.copy()
    other[1] = 5 * x[1, ::-1]
    twice = []
    for v in (x, other):
        session = begun(prior, v)
        twice.append([np.array(session(v, 0.04)) for _ in range(35)][::17])
    for a, b in zip(*twice):
        assert np.array_equal(a[0], b[0])
        assert not np.array_equal(a[1], b[1])


def test_a_constant_stays(classical):
    x = np.full((2, 4, 17, 20), 0.3, np.float32)
    session = begun(classical, x)
    for _ in range(3):
        np.testing.assert_allclose(session(x, 0.2), x, atol=2e-6)


def test_values_stay_in_range(classical):
    """Nothing brighter or darker than the input, but for a little ringing."""
    x = video()
    session = begun(classical, x)
    for _ in range(200):
        out = session(x, 0.1)
    slack = 1e-3 if isinstance(classical, TV) else 0.15
    assert x.min() - slack <= out.min()
    assert out.max() <= x.max() + slack


@pytest.mark.parametrize("dtype", ["uint8", "int64", "float16", ">f4"])
def test_other_dtypes_are_denoised_in_float32(classical, dtype):
    x = (200 * video()).astype(dtype)
    out = denoise(x, 5.0, classical)
    assert out.dtype == np.float32
    np.testing.assert_array_equal(out, denoise(x.astype(np.float32), 5.0, classical))


def test_memory_order_does_not_matter(classical):
    assert np.array_equal(denoise(video(), 0.1, classical), denoise(np.asfortranarray(video()), 0.1, classical))


@pytest.mark.parametrize(
    ("x", "sigma", "error", "message"),
    [
        (np.zeros((3, 4, 5)), 0.1, InputError, r"x has shape \(3, 4, 5\).*views"),
        (np.zeros((1, 0, 4, 4)), 0.1, InputError, "none of them 0"),
        (video(), -0.1, InputError, "sigma is -0.1.*>= 0"),
        (video(), float("nan"), InputError, "sigma is nan.*>= 0"),
        (video(), float("inf"), InputError, "sigma is inf"),
        (video(), "much", InputError, "sigma is 'much'"),
        ("video", 0.1, InputTypeError, "x "),
    ],
)
def test_unfit_input_of_denoise_is_named(x, sigma, error, message):
    with pytest.raises(error, match=message):
        denoise(x, sigma)
