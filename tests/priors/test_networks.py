"""The networks of the priors: what holds for any weights, and what the trained ones achieve."""

from pathlib import Path

import numpy as np
import pytest

import priors
from pnp_sci import datasets
from priors.motion import measure as motion
from priors.motion.measure import measure
from priors.networks import along_motion
from priors.networks.along_motion import VideoNet
from priors.networks.image import ImageNet

torch = pytest.importorskip("torch")
pytest.importorskip("safetensors")
runner = pytest.importorskip("priors.networks.runner")
inference = pytest.importorskip("pnp_sci.accel.inference")
fusion = pytest.importorskip("pnp_sci.accel.fusion")
unet = pytest.importorskip("priors.networks.unet")
files = pytest.importorskip("priors.networks.files")

NETS = {"ffdnet": ImageNet, "video": VideoNet}


def untrained(architecture=unet.SMALL):
    """A network whose last layer is not zero, as it is before training, so that it does something."""
    torch.manual_seed(0)
    network = unet.Network(architecture)
    torch.nn.init.normal_(network.tail.weight, std=0.1)
    return network


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("weights")
    for name in NETS:
        files.save(folder / name, name, unet.SMALL, untrained())
    return folder


@pytest.fixture(params=NETS)
def name(request):
    return request.param


@pytest.fixture
def net(name, weights):
    return NETS[name](weights / name)


@pytest.fixture
def loaded_anew(name, weights):
    """Makes the network with its weights read again, as the processor is taken to be then."""
    yield lambda: runner._opened.cache_clear() or NETS[name](weights / name)
    runner._opened.cache_clear()


def noise(shape, dtype=np.float32):
    return np.random.default_rng(0).random(shape).astype(dtype)


def scene(size):
    """A clip in which something moves: (1, 10, size, size)."""
    return datasets.embedded_scene(size).truth[:1].astype(np.float32)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 3, 5, 7), (1, 64, 8, 8), (3, 2, 33, 16), (1, 5, 40, 33)])
def test_any_shape_and_dtype(net, shape, dtype):
    x = noise(shape, dtype)
    before = x.copy()
    out = net(x, 0.1)
    assert (out.shape, out.dtype) == (shape, dtype)
    assert np.array_equal(x, before)
    assert not np.array_equal(out, x)


@pytest.mark.parametrize("sigma", [1e-30, 1e-9, 2e-4, 0.1, 10.0])
def test_moves_no_pixel_by_more_than_six_sigma(net, sigma):
    x = noise((1, 3, 34, 34), np.float64)
    assert np.abs(net(x, sigma) - x).max() <= 6.0001 * sigma


def test_no_noise_is_the_identity(net):
    x = noise((1, 2, 8, 8))
    out = net(x, 0.0)
    assert np.array_equal(out, x)
    assert out is not x


def test_follows_the_scale(net):
    """D(x / 2, sigma / 2) = D(x, sigma) / 2: to the bit, but where motion is seen, which takes pictures of 8 bits."""
    small, large = scene(16), scene(48)
    assert np.array_equal(2 * net(small / 2, 0.05), net(small, 0.1))
    assert np.abs(2 * net(large / 2, 0.05) - net(large, 0.1)).mean() < 0.005


def test_views_do_not_mix(net):
    x = np.concatenate([scene(40), noise((1, 10, 40, 40))])
    other = x.copy()
    other[1] = 0
    assert np.array_equal(net(other, 0.1)[0], net(x, 0.1)[0])
    np.testing.assert_allclose(net(x[:1], 0.1), net(x, 0.1)[:1], atol=2e-3)


def test_only_the_video_net_looks_at_neighbours(net, name, monkeypatch):
    """Where nothing stands still; else at all frames."""
    monkeypatch.setattr(motion, "_at_rest", lambda pilot, *_: np.zeros(pilot.shape[1:], np.float32))
    x = scene(48)
    x = np.concatenate([x, x[:, -2:0:-1]], 1)  # to and fro
    other = x.copy()
    other[:, 16] = 0
    changed = (net(other, 0.1) != net(x, 0.1)).any(axis=(0, 2, 3))
    assert changed[15] == changed[12] == (name == "video")
    message = "the motion and the weights of four frames either side depend on at most 3 x 4 frames"
    assert not changed[:4].any(), message


def test_the_same_again_whatever_came_between(net):
    """Optical flow must not remember the size or the content of earlier pictures."""
    x = scene(40)
    first = net(x, 0.1)
    net(noise((1, 10, 34, 34)), 0.1)
    assert np.array_equal(net(x, 0.1), first)


def test_motion_serves_several_calls(weights, monkeypatch):
    """The next search begins with what the last has found; after finishing, with nothing."""
    seen, see = [], along_motion.see
    monkeypatch.setattr(along_motion, "see", lambda *given: seen.append(given[-1]) or see(*given))
    denoise, x = VideoNet(weights / "video", renew=3), scene(32)
    for _ in range(4):
        denoise(x, 0.1)
    assert len(seen) == 2
    assert not seen[0]
    assert len(seen[1].views) == 1
    denoise.finish(x, 0.1)
    denoise(x, 0.1)
    assert len(seen) == 3
    assert not seen[2]


def test_frames_too_small_to_show_motion_are_left_to_the_image_net(weights):
    x = noise((1, 3, 31, 40))
    video, image = VideoNet(weights / "video"), ImageNet()
    np.testing.assert_array_equal(video(x, 0.1), image(x, 0.1))
    np.testing.assert_array_equal(video.finish(x, 0.1), x)


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
    denoise = ImageNet(weights / "ffdnet")
    seen = []
    for turn in range(8):
        frames = torch.from_numpy(x[0])
        assert torch.equal(runner.turned(runner.turned(frames, turn), turn, back=True), frames)
        turned = np.rot90(x[..., ::-1] if turn >= 4 else x, turn % 4, (2, 3))
        back = np.rot90(denoise(turned, 0.1), -(turn % 4), (2, 3))
        seen.append(denoise(x, 0.1, turn))
        np.testing.assert_allclose(seen[-1], back[..., ::-1] if turn >= 4 else back, atol=1e-6)
    np.testing.assert_array_equal(denoise(x, 0.1, 9), seen[1])
    clip = VideoNet(weights / "video")
    for frames in (scene(40), scene(40)[:, :1]):  # one frame is left to the image net
        assert len({clip(frames, 0.1, turn).tobytes() for turn in range(8)}) == 8
    assert len({out.tobytes() for out in seen}) == 8


@pytest.mark.parametrize("shape", [(3, 32, 48), (2, 21, 37), (1, 5, 3)])
@pytest.mark.parametrize("turn", range(8))
def test_arrays_and_tensors_have_the_noise_of_the_network(shape, turn, weights, monkeypatch):
    """On a CPU kernels make the input of the network and its output; training and GPUs have it whole."""
    monkeypatch.setattr(inference, "half_precision", lambda _: False)
    runner._opened.cache_clear()
    run = runner.opened(weights / "video", "video", None)
    x, level = noise(shape), np.float32(0.05) + np.abs(noise(shape))
    with inference.running(run.device):
        seen = (runner.turned(torch.from_numpy(a), turn) for a in (x, level))
        whole = runner.turned(run.network(*seen), turn, back=True).numpy()
    assert whole.std() > 1e-3
    np.testing.assert_allclose(run.noise(x, level, turn), whole, atol=1e-5)
    np.testing.assert_allclose(run.noise(torch.from_numpy(x), torch.from_numpy(level), turn), whole, atol=1e-5)
    runner._opened.cache_clear()


def test_long_clips_go_in_pieces(net, monkeypatch):
    x = noise((2, 30, 16, 16))
    whole = net(x, 0.1)
    monkeypatch.setattr(runner, "CACHED", 3 * 16 * 16)
    np.testing.assert_allclose(net(x, 0.1), whole, atol=0.02)


def test_both_precisions_agree(loaded_anew, name, monkeypatch):
    x, outs = noise((1, 4, 32, 32)), []
    for half in (False, True):
        monkeypatch.setattr(inference, "half_precision", lambda device, half=half: half)
        outs.append(loaded_anew()(x, 0.1))
    np.testing.assert_allclose(*outs, atol=0.03 if name == "video" else 0.01)  # motion may differ
    assert not np.array_equal(*outs)


def test_fused_or_not_it_is_the_same(loaded_anew, monkeypatch):
    x, outs, could = scene(40) + np.float32(0.1) * noise((1, 10, 40, 40)), [], fusion._can_fuse
    for possible in (True, False):
        monkeypatch.setattr(fusion, "_can_fuse", lambda dtype, possible=possible: possible and could(dtype))
        net = loaded_anew()
        outs.append(net(x, 0.1))
        fused = any(isinstance(module, fusion.Fused) for module in net.runner.network.modules())
        half = inference.half_precision(torch.device("cpu"))
        assert fused == (possible and could(torch.bfloat16 if half else torch.float32))
    assert np.abs(outs[0] - outs[1]).mean() < 0.005  # the motion may differ a little, too


def psnr(a, b):
    return -10 * np.log10(np.mean((np.clip(a, 0, 1) - b) ** 2))


@pytest.mark.parametrize("level", [15, 40])
def test_trained_weights_denoise_a_moving_pattern(level):
    if not all((Path(priors.__file__).parent / "weights" / f"{name}.safetensors").is_file() for name in NETS):
        pytest.skip("the weights of this package are not there")
    row, column, frame = np.meshgrid(np.arange(64), np.arange(64), np.arange(8), indexing="ij")
    wave = np.sin(0.5 * (row + frame)) * np.cos(0.35 * (column - 2 * frame)) + np.sin(0.15 * (row - column + frame))
    clean = (0.5 + 0.2 * np.moveaxis(wave, 2, 0)[None]).astype(np.float32)
    sigma = level / 255
    noisy = clean + sigma * np.random.default_rng(1).standard_normal(clean.shape, np.float32)
    for name, kind in NETS.items():
        assert psnr(kind()(noisy, sigma), clean) > psnr(noisy, clean) + 5, name
