import numpy as np
import pytest

from pnp_sci import io
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.masks import random_masks
from pnp_sci.sensing.simulate import simulate


@pytest.fixture
def video():
    return np.random.default_rng(1).random((2, 5, 40, 30))


@pytest.fixture
def masks():
    return random_masks((2, 5, 40, 30))


def test_without_noise_it_is_the_sum(video, masks):
    y = simulate(video, masks)
    assert y.dtype == np.float32
    assert y == pytest.approx((video * masks).sum((0, 1)), rel=1e-5)
    assert simulate(video, masks.astype(np.float64)) == pytest.approx((video * masks).sum((0, 1)), rel=1e-14)


def test_single_view_needs_no_view_axis(video, masks):
    assert np.array_equal(simulate(video[0], masks[0]), simulate(video[:1], masks[:1]))


@pytest.mark.parametrize("scale", [1, 1000])
def test_noise_is_relative_to_the_maximum(video, masks, scale):
    clean = simulate(scale * video, masks)
    residual = (simulate(scale * video, masks, noise=0.05) - clean) / clean.max()
    assert residual.std() == pytest.approx(0.05, rel=0.1)
    assert abs(residual.mean()) < 0.01


def test_noise_is_relative_to_peak_and_repeats_with_its_seed(video, masks):
    noisy = simulate(video, masks, noise=0.05, seed=7, peak=100.0)
    assert (noisy - simulate(video, masks)).std() == pytest.approx(5, rel=0.1)
    assert np.array_equal(noisy, simulate(video, masks, noise=0.05, seed=7, peak=100.0))
    assert not np.array_equal(noisy, simulate(video, masks, noise=0.05, seed=8, peak=100.0))


@pytest.mark.parametrize("bits", [1, 8, 12])
def test_bits_make_levels(video, masks, bits):
    clean = simulate(video, masks)
    y = simulate(video, masks, bits=bits)
    step = clean.max() / (2**bits - 1)
    assert y / step == pytest.approx(np.round(y / step), abs=1e-3)
    assert np.abs(y - clean).max() <= step * 0.501
    assert y.max() == pytest.approx(clean.max())


def test_a_peak_below_the_maximum_saturates(video, masks):
    peak = float(np.median(simulate(video, masks)))
    y = simulate(video, masks, noise=0.1, bits=8, peak=peak)
    assert y.min() >= 0
    assert y.max() == pytest.approx(peak)
    assert (y == y.max()).mean() > 0.3


def test_dark_scene_stays_dark(masks):
    assert not simulate(np.zeros(masks.shape), masks, noise=0.1, bits=8).any()


def test_video_from_a_file(video, masks, tmp_path):
    path = tmp_path / "video.npy"
    io.write(path, video.reshape(10, 40, 30))
    assert np.array_equal(simulate(path, masks), simulate(video, masks))
    assert np.array_equal(simulate(str(path), masks), simulate(video, masks))


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"noise": -0.1}, "noise is -0.1"),
        ({"noise": float("nan")}, "noise is nan"),
        ({"bits": 0}, "bits is 0"),
        ({"bits": 8.5}, "bits is 8.5"),
        ({"peak": 0.0}, "peak is 0.0"),
        ({"peak": "1"}, "peak is '1'"),
        ({"bits": 8.0}, "bits is 8.0"),
        ({"seed": -1}, "seed is -1"),
        ({"seed": 1.5}, "seed is 1.5"),
        ({"noise": 1e38}, "the measurement has .* infinite"),
    ],
)
def test_numbers_out_of_range(video, masks, wrong, message):
    with pytest.raises(InputError, match=message):
        simulate(video, masks, **wrong)


def test_shapes_that_differ_and_nan(video, masks):
    with pytest.raises(InputError, match=r"video has shape \(2, 4, 40, 30\), but masks \(2, 5, 40, 30\)"):
        simulate(video[:, :4], masks)
    video[0, 0, 0, 0] = np.nan
    with pytest.raises(InputError, match="video has 1 value"):
        simulate(video, masks)


def test_videos_that_are_no_array_of_numbers(video, masks):
    with pytest.raises(InputTypeError, match="video is no array of numbers"):
        simulate([[1], [1, 2]], masks)
    with pytest.raises(InputTypeError, match="video is a masked array with 1 masked value"):
        simulate(np.ma.masked_equal(video, video[0, 0, 0, 0]), masks)
