import numpy as np
import pytest
from skimage.metrics import peak_signal_noise_ratio, structural_similarity

from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.metrics import psnr, ssim


@pytest.fixture
def pair():
    rng = np.random.default_rng(0)
    reference = rng.random((2, 3, 24, 20))
    return reference + 0.1 * rng.standard_normal(reference.shape), reference


def test_scores_follow_the_convention(pair):
    """Per view, the mean over frames of scikit-image's score of the clipped estimate."""
    x, reference = pair
    clipped = np.clip(x, 0, 1)
    settings = {"data_range": 1, "gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    for v in range(2):
        frames = list(zip(reference[v], clipped[v]))
        assert psnr(x, reference)[v] == pytest.approx(
            np.mean([peak_signal_noise_ratio(a, b, data_range=1) for a, b in frames])
        )
        assert ssim(x, reference)[v] == pytest.approx(
            np.mean([structural_similarity(a, b, **settings) for a, b in frames])
        )


@pytest.mark.parametrize("score", [psnr, ssim])
def test_dimensions(score, pair):
    x, reference = pair
    views = score(x, reference)
    assert views.shape == (2,)
    assert score(x[1], reference[1]) == pytest.approx(views[1])
    assert score(x[0, 0], reference[0, 0]) == pytest.approx(score(x[0, :1], reference[0, :1]))


@pytest.mark.parametrize("score", [psnr, ssim])
def test_float32_agrees_with_float64(score, pair):
    x, reference = pair
    assert score(x.astype(np.float32), reference.astype(np.float32)) == pytest.approx(score(x, reference), abs=1e-4)


def test_perfect_and_worse(pair):
    x, reference = pair
    assert np.all(np.isposinf(psnr(reference, reference)))
    assert ssim(reference, reference) == pytest.approx(1)
    worse = reference + 2 * (x - reference)
    assert np.all(psnr(worse, reference) < psnr(x, reference))
    assert np.all(ssim(worse, reference) < ssim(x, reference))


def test_nan_shows(pair):
    x, reference = pair
    x[0, 1, 2, 3] = np.nan
    assert np.isnan(psnr(x, reference)).tolist() == [True, False]


def test_small_frames_have_no_ssim_but_psnr():
    frame = np.full((2, 10, 30), 0.5)
    assert np.isnan(ssim(frame, frame))
    assert psnr(frame + 0.1, frame) == pytest.approx(20)


@pytest.mark.parametrize("score", [psnr, ssim])
def test_wrong_input_is_named(score):
    frame = np.zeros((4, 5))
    with pytest.raises(InputError, match=r"\(4, 5\) and reference \(5, 4\)"):
        score(frame, frame.T)
    with pytest.raises(InputError, match="reference spans 0 to 255"):
        score(frame, np.linspace(0, 255, 20).reshape(4, 5))
    with pytest.raises(InputTypeError, match="x is a masked array"):
        score(np.ma.masked_equal(np.eye(20), 1), np.eye(20))
    with pytest.raises(InputTypeError, match="x has dtype complex128"):
        score(frame + 0j, frame)


@pytest.mark.parametrize("score", [psnr, ssim])
def test_the_types_say_what_is_white(score, pair):
    counts = [np.round(np.clip(video, 0, 1) * 255).astype(np.uint8) for video in pair]
    scaled = [video / 255 for video in counts]
    assert score(*counts) == pytest.approx(score(*scaled))
    for mixed in ((counts[0], scaled[1]), (scaled[0], counts[1])):
        with pytest.raises(InputError, match="the same dtype was expected; peak="):
            score(*mixed)
    assert score(counts[0].astype(float), counts[1], peak=255) == pytest.approx(score(*scaled))


@pytest.mark.parametrize("score", [psnr, ssim])
def test_white_of_uint16_must_be_said(score, pair):
    counts = [np.round(np.clip(video, 0, 1) * 4095).astype(np.uint16) for video in pair]
    with pytest.raises(InputError, match=r"uint16.*peak="):
        score(*counts)
    assert score(*counts, peak=4095) == pytest.approx(score(*(video / 4095 for video in counts)))


def test_another_unit_is_said(caplog):
    video = np.full((1, 2, 16, 16), 0.5)
    psnr(1.5 * video, video)
    assert not caplog.messages
    psnr(255 * video, video)
    assert "more than half of x is above 2 where white is 1" in caplog.messages[0]
