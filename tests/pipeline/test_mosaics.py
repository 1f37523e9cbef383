"""Mosaics from the raw measurement to the colour video."""

from functools import cache
from importlib.util import find_spec

import numpy as np
import pytest
from skimage import data

import pnp_sci
from pnp_sci.errors import InputError
from pnp_sci.pipeline import tiles
from pnp_sci.plugins import registry
from pnp_sci.plugins.combine import Identity, Stages
from pnp_sci.plugins.mosaic import Mosaicked
from pnp_sci.scene import choose
from pnp_sci.sensing.mosaic import PATTERNS, Mosaic, planes
from pnp_sci.testing import check_prior
from priors.tv import TV
from priors.wavelet import Wavelet

SIZE, FRAMES = 64, 4


@cache
def scene(size=SIZE):
    """Two colour pictures that pan, (V, B, H, W, 3), and masks."""
    views = []
    for picture, step in ((data.astronaut(), (1, 1)), (data.coffee(), (-1, 2))):
        small = picture[: 400 // 3 * 3, : 510 // 3 * 3].reshape(133, 3, 170, 3, 3).mean((1, 3)) / 255
        views.append([np.roll(small, (t * step[0], t * step[1]), (0, 1))[20 : 20 + size, 30 : 30 + size]
                      for t in range(FRAMES)])  # fmt: skip
    truth = np.array(views, np.float32)
    return truth, pnp_sci.random_masks(truth.shape[:4], seed=1)


def measured(pattern="RGGB", gains=(1, 1, 1), **options):
    truth, masks = scene()
    truth = truth * np.array(gains, np.float32)
    return pnp_sci.simulate(truth, masks, mosaic=pattern, **options), masks, truth


@cache
def solved(pattern="RGGB", gains=(1, 1, 1), prior="tv"):
    y, masks, truth = measured(pattern, gains)
    return pnp_sci.solve(y, masks, prior, mosaic=pattern, reference=truth, peak=1), truth


@pytest.mark.parametrize("pattern", PATTERNS)
def test_every_pattern_gives_the_same_colours(pattern):
    result, truth = solved(pattern)
    assert result.x.shape == truth.shape
    assert result.settings["mosaic"] == pattern
    score = np.mean(pnp_sci.psnr(result.x, truth))
    assert score == pytest.approx(result.history[-1].psnr, abs=1e-3)
    assert score == pytest.approx(np.mean(pnp_sci.psnr(solved()[0].x, truth)), abs=0.5)


@pytest.mark.parametrize("prior", ["tv", "flow"])
def test_it_is_better_than_each_colour_by_itself(prior):
    result, truth = solved(prior=prior)
    y, masks, _ = measured()
    apart = np.empty(masks.shape, np.float32)
    for i, j in np.ndindex(2, 2):
        own = np.ascontiguousarray(masks[..., i::2, j::2])
        apart[..., i::2, j::2] = pnp_sci.solve(y[i::2, j::2], own, prior).x
    other = Mosaic("RGGB").demosaic(planes(apart))
    assert np.mean(pnp_sci.psnr(result.x, truth)) > np.mean(pnp_sci.psnr(other, truth)) + 0.5


def test_a_weak_colour_is_recovered_as_well():
    """A sensor that sees 0.3 of the red gives 0.3 of the red."""
    gains = np.array([0.3, 1, 1], np.float32)
    (full, truth), (weak, _) = solved(), solved(gains=tuple(gains.tolist()))
    ratios = [float((weak.x[..., c] * full.x[..., c]).sum() / (full.x[..., c] ** 2).sum()) for c in range(3)]
    np.testing.assert_allclose(ratios, gains, rtol=0.05)
    scores = [np.mean(pnp_sci.psnr(x, truth)) for x in (full.x, weak.x / gains)]
    np.testing.assert_allclose(*scores, atol=0.5)


def test_units_are_those_of_y():
    (one, _), (y, masks, _) = solved(), measured()
    np.testing.assert_allclose(pnp_sci.solve(1000 * y, masks, mosaic="RGGB").x, 1000 * one.x, rtol=1e-3, atol=1)


def test_several_measurements_alone_and_as_one_video():
    y, masks, truth = measured()
    both = np.stack([y, y])
    apart = pnp_sci.solve(both, masks, mosaic="RGGB", iterations=5)
    assert apart.x.shape == (2, *truth.shape)
    assert apart[1].x.shape == truth.shape
    np.testing.assert_allclose(apart.x[0], apart.x[1])
    assert pnp_sci.solve(both, masks, mosaic="RGGB", sequence=True, iterations=5).x.shape == (2, *truth.shape)


def test_a_sequence_gains_in_colour_and_on_tensors_as_well():
    _, masks, truth = measured()
    film = [truth, truth[:, ::-1], truth]  # there and back
    ys = np.stack([pnp_sci.simulate(video, masks, mosaic="RGGB") for video in film])
    how = {"mosaic": "RGGB", "iterations": 80, "scene": "full"}
    apart, together = (pnp_sci.solve(ys, masks, sequence=sequence, **how).x for sequence in (False, True))
    error = [np.mean((x - np.stack(film)) ** 2) for x in (apart, together)]
    assert error[1] < 0.98 * error[0]
    if find_spec("torch"):
        tensors = pnp_sci.solve(ys, masks, sequence=True, backend="torch", **how).x
        np.testing.assert_allclose(tensors, together, atol=1e-3)
    first = np.stack(film)
    for sequence in (False, 3):
        kept = pnp_sci.solve(ys, masks, "none", init=first, mosaic="RGGB", iterations=1, sequence=sequence)
        np.testing.assert_allclose(Mosaic("RGGB").sample(kept.x), Mosaic("RGGB").sample(first), atol=1e-3)


def test_a_first_estimate_is_in_colour():
    y, masks, truth = measured()
    kept = pnp_sci.solve(y, masks, "none", init=truth, mosaic="RGGB", iterations=1)
    seen = Mosaic("RGGB").sample
    np.testing.assert_allclose(seen(kept.x), seen(truth), atol=1e-3)


def test_bad_pixels_are_left_out():
    y, masks, truth = measured()
    bad = np.zeros(y.shape, bool)
    bad[10:50:9, 7:50:8] = True
    hot = np.where(bad, 10 * y.max(), y)
    result = pnp_sci.solve(hot, masks, mosaic="RGGB", bad=bad)
    assert np.mean(pnp_sci.psnr(result.x, truth)) > np.mean(pnp_sci.psnr(solved()[0].x, truth)) - 0.5
    assert result.scene["bad"] == bad.sum()


def test_large_pictures_have_no_seam(monkeypatch):
    y, masks, truth = measured()
    options = {"mosaic": "RGGB", "scene": "full", "iterations": 40}
    whole = pnp_sci.solve(y, masks, **options)
    monkeypatch.setattr(tiles, "MOST", 8 * 48**2)
    monkeypatch.setattr(tiles, "MARGIN", 8)
    parts = pnp_sci.solve(y, masks, **options)
    assert np.abs(parts.x - whole.x).max() > 0, "there were tiles"
    np.testing.assert_allclose(pnp_sci.psnr(parts.x, truth), pnp_sci.psnr(whole.x, truth), atol=0.2)


def test_decoders_see_one_colour_at_a_time():
    pytest.importorskip("torch")
    truth = np.broadcast_to(np.array([0.3, 0.6, 0.4], np.float32), (2, 6, 64, 64, 3))
    masks = pnp_sci.moving_masks(truth.shape[:4], seed=0)
    y = pnp_sci.simulate(truth, masks, mosaic="GRBG")
    result = pnp_sci.decode(y, masks, "ofanet-fast", mosaic="GRBG")
    assert result.x.shape == truth.shape
    np.testing.assert_allclose(np.median(result.x, (0, 1, 2, 3)), truth[0, 0, 0, 0], atol=0.05)


@pytest.mark.parametrize("prior", [TV(), Wavelet()], ids=lambda prior: type(prior).__name__)
def test_mosaicked_priors_keep_their_promises(prior):
    check_prior(Mosaicked(prior, Mosaic("RGGB")), shapes=[(2, 4, 64, 64), (1, 1, 8, 6), (3, 2, 2, 2)])


def test_nothing_is_done_without_denoising():
    x = np.random.default_rng(0).random((2, 3, 8, 8))
    session = Mosaicked(Identity(), Mosaic("BGGR")).begin(x.shape, x.dtype)
    np.testing.assert_allclose(session(x.copy(), 0.1), x, atol=1e-12)


def test_stages_and_functions_serve():
    y, masks, truth = measured()
    stages = [("tv", 3), (lambda x, sigma: 0.5 * x, 2)]
    result = pnp_sci.solve(y, masks, stages, mosaic="RGGB")
    assert result.history[-1].iteration == 5
    assert pnp_sci.solve(y, masks, Stages([(TV(), 3)]), mosaic="RGGB").x.shape == truth.shape
    assert "TV to iteration" in str(solved()[0])
    papers = " ".join(pnp_sci.citations(solved()[0]))
    assert "Linear demosaicing" in papers
    assert "Chambolle" in papers


def test_a_still_scene_is_recognised():
    truth, masks = scene()
    y = pnp_sci.simulate(np.repeat(truth[:, :1], FRAMES, 1), masks, mosaic="RGGB")
    assert pnp_sci.solve(y, masks, mosaic="RGGB").scene["still"] is True
    assert solved()[0].scene["still"] is False


@pytest.mark.parametrize("size", [28, 64])
def test_the_reason_says_whether_the_scene_was_judged(size, monkeypatch):
    truth, masks = scene()
    video, masks = truth[:, :, :size, :size], np.ascontiguousarray(masks[..., :size, :size])
    y = pnp_sci.simulate(video, masks, mosaic="RGGB")
    if size > choose.SMALLEST:
        monkeypatch.delitem(registry._installed("priors"), "flow")
    expected = "a mosaic of fewer than 32 pixels a side" if size == 28 else "the prior flow is not installed"
    assert pnp_sci.solve(y, masks, mosaic="RGGB", iterations=1).scene["reason"] == f"not judged: {expected}"
    assert pnp_sci.solve(y, masks, mosaic="RGGB", iterations=1, scene="full").scene["reason"] == "as asked for"


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"mosaic": "RGB"}, "mosaic is 'RGB'"),
        ({"register": True}, "register"),
        ({"uncertainty": True}, "uncertainty"),
        ({"init": np.ones((2, FRAMES, SIZE, SIZE))}, r"init has shape \(2, 4, 64, 64\)"),
        ({"reference": np.ones((2, FRAMES, SIZE, SIZE))}, "reference has shape"),
    ],
)
def test_errors_name_the_argument(options, match):
    y, masks, _ = measured()
    with pytest.raises(InputError, match=match):
        pnp_sci.solve(y, masks, **{"mosaic": "RGGB"} | options)


def test_odd_pictures_are_refused():
    with pytest.raises(InputError, match=r"y has shape \(7, 8\): even rows"):
        pnp_sci.solve(np.ones((7, 8)), np.ones((1, 2, 7, 8)), mosaic="RGGB")


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("weight", [0, 1e-200, 1e-30])
def test_masks_that_are_closed_for_a_colour(weight):
    """They tell nothing of its brightness, whatever y is there."""
    y, masks, _ = measured()
    masks = masks.astype(float)
    masks[..., ::2, ::2] *= weight
    assert np.isfinite(pnp_sci.solve(y.astype(float), masks, mosaic="RGGB", iterations=2).x).all()
