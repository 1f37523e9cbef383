"""Learned priors: the contract with any weights, weights that do not fit, and what the trained ones achieve."""

import subprocess
import sys

import numpy as np
import pytest

from pnp_sci import datasets
from pnp_sci.errors import DataUnavailableError, FormatError, InputError, InputTypeError
from priors import video
from priors.ffdnet import FFDNet
from priors.motion import measure as motion
from priors.motion.measure import measure
from priors.video import VideoDenoiser

torch = pytest.importorskip("torch")
save_file = pytest.importorskip("safetensors.torch").save_file
_inference = pytest.importorskip("priors.networks.runner")
inference = pytest.importorskip("pnp_sci.accel.inference")
fusion = pytest.importorskip("pnp_sci.accel.fusion")
_network = pytest.importorskip("priors.networks.unet")
_weights = pytest.importorskip("priors.networks.files")

PRIORS = [FFDNet, VideoDenoiser]


def untrained(architecture=_network.SMALL):
    """A network whose last layer is not zero, as it is before training, so that it does something."""
    torch.manual_seed(0)
    network = _network.Network(architecture)
    torch.nn.init.normal_(network.tail.weight, std=0.1)
    return network


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    for cls in PRIORS:
        _weights.save(folder / cls.name, cls.name, _network.SMALL, untrained())
    return folder


@pytest.fixture(params=PRIORS, ids=lambda cls: cls.name)
def prior(request, weights):
    return request.param(weights / request.param.name)


def noise(shape, dtype=np.float32):
    return np.random.default_rng(0).random(shape).astype(dtype)


def scene(size):
    """A clip in which something moves: (1, 10, size, size)."""
    return datasets.embedded_scene(size).truth[:1].astype(np.float32)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 5, 7), (1, 64, 8, 8), (3, 2, 33, 16), (1, 5, 40, 33)])
def test_any_shape_and_dtype(prior, shape, dtype):
    x = noise(shape, dtype)
    before = x.copy()
    out = prior(x, 0.1)
    assert (out.shape, out.dtype) == (shape, dtype)
    assert np.array_equal(x, before)
    assert not np.array_equal(out, x)


@pytest.mark.parametrize("sigma", [1e-30, 1e-9, 2e-4, 0.1, 10.0])
def test_moves_no_pixel_by_more_than_six_sigma(prior, sigma):
    x = noise((1, 3, 34, 34), np.float64)
    assert np.abs(prior(x, sigma) - x).max() <= 6.0001 * sigma


def test_no_noise_is_the_identity(prior):
    x = noise((1, 2, 8, 8))
    out = prior(x, 0.0)
    assert np.array_equal(out, x)
    assert out is not x


def test_follows_the_scale(prior):
    """D(x / 2, sigma / 2) = D(x, sigma) / 2: to the bit, but where motion is seen, which takes pictures of 8 bits."""
    small, large = scene(16), scene(48)
    assert np.array_equal(2 * prior(small / 2, 0.05), prior(small, 0.1))
    assert np.abs(2 * prior(large / 2, 0.05) - prior(large, 0.1)).mean() < 0.005


def test_views_do_not_mix(prior):
    x = np.concatenate([scene(40), noise((1, 10, 40, 40))])
    other = x.copy()
    other[1] = 0
    assert np.array_equal(prior(other, 0.1)[0], prior(x, 0.1)[0])
    np.testing.assert_allclose(prior(x[:1], 0.1), prior(x, 0.1)[:1], atol=2e-3)


def test_only_the_video_net_looks_at_neighbours(prior, monkeypatch):
    """Where nothing stands still; else at all frames."""
    monkeypatch.setattr(motion, "_at_rest", lambda pilot, *_: np.zeros(pilot.shape[1:], np.float32))
    x = scene(48)
    x = np.concatenate([x, x[:, -2:0:-1]], 1)  # to and fro
    other = x.copy()
    other[:, 12] = 0
    changed = (prior(other, 0.1) != prior(x, 0.1)).any(axis=(0, 2, 3))
    assert changed[11] == changed[9] == (prior.name == "video")
    message = "three frames either side help, three of theirs decide how far, and three of those where they come from"
    assert not changed[:3].any(), message


def test_the_same_again_whatever_came_between(prior):
    """Optical flow must not remember the size or the content of earlier pictures."""
    x = scene(40)
    first = prior(x, 0.1)
    prior(noise((1, 10, 34, 34)), 0.1)
    assert np.array_equal(prior(x, 0.1), first)


def test_motion_serves_several_calls_until_it_is_forgotten(weights, monkeypatch):
    seen = []
    monkeypatch.setattr(video, "see", lambda *given, see=video.see: seen.append(given[-1]) or see(*given))
    denoise, x = VideoDenoiser(weights / "video", renew=3), scene(32)
    denoise.image = FFDNet(weights / "ffdnet")
    for _ in range(4):
        denoise(x, 0.1)
    assert not seen[0]
    assert len(seen[1]) == 1, "the second search begins with what the first has found"
    denoise.reset()
    denoise(x, 0.1)
    denoise(x[..., 1:], 0.1)
    denoise(x[:, 1:], 0.1)
    assert len(seen) == 4, "the second of these frames is too small to show motion"
    assert not any(seen[2:])


def test_what_averages_leave_of_noise():
    """Of white noise, as `Motion.remaining` says."""
    x = scene(64)[0]
    seen = measure(x, 3, 0.2, 1.5, 1e-3)
    white = np.random.default_rng(0).standard_normal((20, *x.shape), np.float32)
    left = np.empty_like(white)
    for noise, out in zip(white, left):
        seen.average(noise, out)
    assert seen.remaining.shape == x.shape
    assert 1 / np.sqrt(7) <= seen.remaining.min() < 0.5
    assert np.sqrt((left**2).mean()) == pytest.approx(np.sqrt((seen.remaining**2).mean()), rel=0.2)


def test_network_believes_the_level_of_each_pixel():
    """The bound follows the map, and a map that is the same everywhere is a number."""
    network = untrained().eval()
    x, level = torch.rand(2, 16, 24), torch.full((2, 16, 24), 0.001)
    level[:, :, 12:] = 0.1
    with torch.no_grad():
        noise = network(x, level).abs()
    assert (noise <= 6.0001 * level).all()
    assert noise[:, :, 12:].max() > 0.006


def test_frames_are_turned_and_mirrored_for_the_network_and_turned_back(weights):
    """Eight ways of seeing them, and each is that of frames which came so."""
    x = noise((1, 2, 16, 24))
    denoise = FFDNet(weights / "ffdnet")
    seen = []
    for turn in range(8):
        frames = torch.from_numpy(x[0])
        assert torch.equal(_inference.turned(_inference.turned(frames, turn), turn, back=True), frames)
        turned = np.rot90(x[..., ::-1] if turn >= 4 else x, turn % 4, (2, 3))
        back = np.rot90(denoise(turned, 0.1), -(turn % 4), (2, 3))
        seen.append(denoise(x, 0.1, turn))
        np.testing.assert_allclose(seen[-1], back[..., ::-1] if turn >= 4 else back, atol=1e-6)
    np.testing.assert_array_equal(denoise(x, 0.1, 9), seen[1])
    clip = VideoDenoiser(weights / "video")
    for frames in (scene(40), scene(40)[:, :1]):  # one frame is left to the image net
        assert len({clip(frames, 0.1, turn).tobytes() for turn in range(8)}) == 8
    assert len({out.tobytes() for out in seen}) == 8


def test_long_clips_go_in_pieces(prior, monkeypatch):
    x = noise((2, 30, 16, 16))
    whole = prior(x, 0.1)
    monkeypatch.setattr(_inference, "CACHED", 3 * 16 * 16)
    np.testing.assert_allclose(prior(x, 0.1), whole, atol=0.02)


@pytest.mark.parametrize("cls", PRIORS)
def test_both_precisions_agree(cls, weights, monkeypatch):
    x = noise((1, 4, 32, 32))
    outs = []
    for half in (False, True):
        monkeypatch.setattr(inference, "half_precision", lambda device, half=half: half)
        outs.append(cls(weights / cls.name)(x, 0.1))
    np.testing.assert_allclose(*outs, atol=0.03 if cls is VideoDenoiser else 0.01)  # motion may differ
    assert not np.array_equal(*outs)


@pytest.mark.parametrize("cls", PRIORS)
def test_fused_or_not_it_is_the_same(cls, weights, monkeypatch):
    x, outs, could = scene(40) + np.float32(0.1) * noise((1, 10, 40, 40)), [], fusion._can_fuse
    for possible in (True, False):
        monkeypatch.setattr(fusion, "_can_fuse", lambda dtype, possible=possible: possible and could(dtype))
        prior = cls(weights / cls.name)
        outs.append(prior(x, 0.1))
        fused = any(isinstance(module, fusion.Fused) for module in prior._runner.network.modules())
        half = inference.half_precision(torch.device("cpu"))
        assert fused == (possible and could(torch.bfloat16 if half else torch.float32))
    assert np.abs(outs[0] - outs[1]).mean() < 0.005  # the motion may differ a little, too


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


@pytest.mark.parametrize("renew", [0, 1.5, "often"])
def test_an_unfit_renew_is_named(renew):
    with pytest.raises(InputError, match=r"renew is.*>= 1"):
        VideoDenoiser(renew=renew)


def test_unknown_device(weights):
    with pytest.raises(InputError, match="device: 'abacus'"):
        FFDNet(weights / "ffdnet", device="abacus").sha256  # noqa: B018, reading it loads the weights


def test_weights_survive_the_file(weights, tmp_path):
    network, digest = _weights.load(weights / "video", "video")
    assert _weights.save(tmp_path / "again", "video", network.architecture, network) == digest
    assert FFDNet(weights / "ffdnet").sha256 == _weights.load(weights / "ffdnet", "ffdnet")[1]
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
    _weights.save(tmp_path / "misfit", "video", _network.Architecture((8, 8), (1, 1)), untrained())
    with pytest.raises(FormatError, match="do not fit"):
        _weights.load(tmp_path / "misfit", "video")


def test_torch_is_loaded_at_the_first_call_only():
    code = (
        "import sys, numpy as np; from priors.ffdnet import FFDNet; from priors.video import VideoDenoiser;"
        "x = np.zeros((1, 1, 2, 2)); FFDNet()(x, 0); VideoDenoiser()(x, 0); assert 'torch' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_says_what_to_install_without_torch(weights, monkeypatch):
    monkeypatch.setitem(sys.modules, "priors.networks.runner", None)
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
