"""Learned priors: the contract with any weights, weights that do not fit, and what the trained ones achieve."""

import subprocess
import sys

import numpy as np
import pytest

from pnp_sci.errors import DataUnavailableError, FormatError, InputError, InputTypeError
from priors.ffdnet import FFDNet
from priors.video import VideoDenoiser

torch = pytest.importorskip("torch")
save_file = pytest.importorskip("safetensors.torch").save_file
_inference = pytest.importorskip("priors._inference")
_network = pytest.importorskip("priors._network")
_weights = pytest.importorskip("priors._weights")

PRIORS = [FFDNet, VideoDenoiser]


def untrained(name):
    """A network whose last layer is not zero, as it is before training, so that it does something."""
    torch.manual_seed(0)
    network = _network.Network(_network.ARCHITECTURES[name])
    torch.nn.init.normal_(network.tail.weight, std=0.1)
    return network


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    for cls in PRIORS:
        _weights.save(folder / cls.name, cls.name, _network.ARCHITECTURES[cls.name], untrained(cls.name))
    return folder


@pytest.fixture(params=PRIORS, ids=lambda cls: cls.name)
def prior(request, weights):
    return request.param(weights / request.param.name)


def noise(shape, dtype=np.float32):
    return np.random.default_rng(0).random(shape).astype(dtype)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 5, 7), (1, 64, 8, 8), (3, 2, 33, 16)])
def test_any_shape_and_dtype(prior, shape, dtype):
    x = noise(shape, dtype)
    before = x.copy()
    out = prior(x, 0.1)
    assert (out.shape, out.dtype) == (shape, dtype)
    assert np.array_equal(x, before)
    assert not np.array_equal(out, x)


@pytest.mark.parametrize("sigma", [1e-9, 1e-4, 0.1, 10.0])
def test_moves_no_pixel_by_more_than_six_sigma(prior, sigma):
    x = noise((1, 3, 24, 24), np.float64)
    assert np.abs(prior(x, sigma) - x).max() <= 6.0001 * sigma


def test_no_noise_is_the_identity(prior):
    x = noise((1, 2, 8, 8))
    out = prior(x, 0.0)
    assert np.array_equal(out, x)
    assert out is not x


def test_follows_the_scale(prior):
    """D(4 x, 4 sigma) = 4 D(x, sigma), to the bit for a power of two."""
    x = noise((1, 3, 16, 16))
    assert np.array_equal(prior(4 * x, 0.4), 4 * prior(x, 0.1))


def test_views_do_not_mix(prior):
    x = noise((2, 4, 16, 16))
    other = x.copy()
    other[1] = 0
    assert np.array_equal(prior(other, 0.1)[0], prior(x, 0.1)[0])
    np.testing.assert_allclose(prior(x[:1], 0.1), prior(x, 0.1)[:1], atol=2e-3)


def test_only_the_video_net_looks_at_neighbours(prior):
    x = noise((1, 7, 16, 16))
    other = x.copy()
    other[:, 6] = 0
    changed = (prior(other, 0.1) != prior(x, 0.1)).any(axis=(0, 2, 3))
    assert changed[5] == changed[0] == (prior.name == "video")


def test_ends_of_the_clip_are_reflected():
    """The window of the first frame is that of the middle frame of the clip continued by reflection."""
    network = _network.Network(_network.Architecture((8,), (0,), window=2))
    torch.nn.init.normal_(network.tail.weight)
    x, sigma = torch.rand(1, 4, 8, 8), torch.tensor([0.1])
    continued = x[:, [2, 1, 0, 1, 2, 3, 2, 1]]
    torch.testing.assert_close(network(x, sigma), network(continued, sigma)[:, 2:6])


def test_shift_has_the_right_gradient():
    x = torch.randn(6, 8, 2, 2, dtype=torch.double, requires_grad=True)
    for views in (1, 2, 6):
        assert torch.autograd.gradcheck(lambda x, views=views: _network.Shift.apply(x, views, 3), x)


def test_long_clips_go_in_pieces(prior, monkeypatch):
    x = noise((2, 30, 16, 16))
    whole = prior(x, 0.1)
    monkeypatch.setattr(_inference, "PIXELS", 16 * 16 * 16)
    monkeypatch.setattr(_inference, "CACHED", 3 * 16 * 16)
    np.testing.assert_allclose(prior(x, 0.1), whole, atol=0.02)


def test_both_precisions_agree(prior):
    x = noise((1, 4, 32, 32))
    outs = []
    for half in (False, True):
        prior._runner.half = half
        outs.append(prior(x, 0.1))
    np.testing.assert_allclose(*outs, atol=0.01)
    assert not np.array_equal(*outs)


@pytest.mark.parametrize(
    ("x", "sigma", "error", "match"),
    [
        (np.zeros((1, 1, 4, 4), np.uint8), 0.1, InputTypeError, "uint8"),
        (np.zeros((1, 4, 4)), 0.1, InputError, r"\(1, 4, 4\)"),
        (np.zeros((1, 0, 4, 4)), 0.1, InputError, "none of them 0"),
        (np.zeros((1, 1, 4, 4)), -0.1, InputError, "sigma is -0.1"),
        (np.zeros((1, 1, 4, 4)), float("nan"), InputError, "sigma is nan"),
    ],
)
def test_input_that_cannot_be_used(prior, x, sigma, error, match):
    with pytest.raises(error, match=match):
        prior(x, sigma)


def test_unknown_device(weights):
    with pytest.raises(InputError, match="device: 'abacus'"):
        FFDNet(weights / "ffdnet", device="abacus").sha256  # noqa: B018, reading it loads the weights


def test_weights_survive_the_file(weights, tmp_path):
    network, digest = _weights.load(weights / "video", "video")
    assert _weights.save(tmp_path / "again", "video", network.architecture, network) == digest
    assert VideoDenoiser(weights / "video").sha256 == digest
    assert not list(tmp_path.glob("*.partial"))


def test_weights_that_do_not_fit(weights, tmp_path):
    with pytest.raises(DataUnavailableError, match=r"python -m priors\.train video"):
        _weights.load(tmp_path / "none", "video")
    with pytest.raises(FormatError, match="holds ffdnet, but video was expected"):
        _weights.load(weights / "ffdnet", "video")
    (tmp_path / "text").write_text("not weights at all")
    with pytest.raises(FormatError, match="not a safetensors file"):
        _weights.load(tmp_path / "text", "video")
    save_file({"a": torch.zeros(1)}, tmp_path / "foreign")
    with pytest.raises(FormatError, match="no prior of this package"):
        _weights.load(tmp_path / "foreign", "video")
    damaged = bytearray((weights / "video").read_bytes())
    damaged[-1] ^= 1
    (tmp_path / "damaged").write_bytes(damaged)
    with pytest.raises(FormatError, match="damaged"):
        _weights.load(tmp_path / "damaged", "video")
    _weights.save(tmp_path / "misfit", "video", _network.ARCHITECTURES["video"], untrained("ffdnet"))
    with pytest.raises(FormatError, match="do not fit"):
        _weights.load(tmp_path / "misfit", "video")


def test_torch_is_loaded_at_the_first_call_only():
    code = (
        "import sys, numpy as np; from priors.ffdnet import FFDNet; from priors.video import VideoDenoiser;"
        "x = np.zeros((1, 1, 2, 2)); FFDNet()(x, 0); VideoDenoiser()(x, 0); assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_says_what_to_install_without_torch(weights, monkeypatch):
    monkeypatch.setitem(sys.modules, "priors._inference", None)
    with pytest.raises(ImportError, match=r"pnp-sci\[learned\]"):
        FFDNet(weights / "ffdnet")(noise((1, 1, 4, 4)), 0.1)


def psnr(a, b):
    return -10 * np.log10(np.mean((np.clip(a, 0, 1) - b) ** 2))


@pytest.mark.parametrize("level", [15, 40])
def test_trained_weights_denoise_a_moving_pattern(level):
    if not all(cls().weights.is_file() for cls in PRIORS):
        pytest.skip("the weights of this package are not there")
    row, column, frame = np.meshgrid(np.arange(64), np.arange(64), np.arange(8), indexing="ij")
    wave = np.sin(0.5 * (row + frame)) * np.cos(0.35 * (column - 2 * frame)) + np.sin(0.15 * (row - column + frame))
    clean = (0.5 + 0.2 * np.moveaxis(wave, 2, 0)[None]).astype(np.float32)
    sigma = level / 255
    noisy = clean + sigma * np.random.default_rng(1).standard_normal(clean.shape, np.float32)
    for cls in PRIORS:
        assert psnr(cls()(noisy, sigma), clean) > psnr(noisy, clean) + 5, cls
