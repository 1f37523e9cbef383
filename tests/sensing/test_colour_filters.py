"""Mosaics: what the sensor sees, its luma and chroma, and demosaicing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pnp_sci import Mosaicked, SensingOperator, simulate
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.sensing.mosaic import CELL, PATTERNS, Mosaic, planes, quarters

patterns = st.sampled_from(PATTERNS).map(Mosaic)
every_pattern = pytest.mark.parametrize("mosaic", [Mosaic(pattern) for pattern in PATTERNS], ids=PATTERNS)


def noise(*shape, seed=0):
    return np.random.default_rng(seed).random(shape)


@every_pattern
def test_each_pixel_sees_its_colour(mosaic):
    video = noise(2, 3, 4, 6, 3)
    seen = mosaic.sample(video)
    for i, j in np.ndindex(4, 6):
        colour = "RGB".index(mosaic.pattern[2 * (i % 2) + j % 2])
        assert np.array_equal(seen[..., i, j], video[..., i, j, colour])


@given(rows=st.integers(1, 5), columns=st.integers(1, 5))
def test_planes_hold_every_pixel_once(rows, columns):
    picture = np.arange(4 * rows * columns).reshape(2 * rows, 2 * columns)
    lying = planes(picture)
    for (i, j), where in zip(CELL, quarters(picture.shape)):
        assert np.array_equal(lying[(..., *where)], picture[..., i::2, j::2])
    assert np.array_equal(planes(picture)[:rows, columns:], picture[::2, 1::2])


@given(mosaic=patterns, rows=st.integers(1, 4), columns=st.integers(1, 4), seed=st.integers(0, 9))
def test_luma_and_chroma_are_the_whole_video(mosaic, rows, columns, seed):
    x = noise(2, 3, 2 * rows, 2 * columns, seed=seed)
    luma, chroma = mosaic.split(x)
    assert chroma.shape == (4, 3, rows, columns)
    np.testing.assert_allclose(mosaic.join(luma, chroma), x, atol=1e-12)


@every_pattern
def test_grey_is_luma_alone(mosaic):
    grey = np.full((1, 2, 8, 8), 0.3)
    luma, chroma = mosaic.split(grey)
    np.testing.assert_allclose(luma, 0.3)
    np.testing.assert_allclose(chroma, 0, atol=1e-12)


@every_pattern
def test_colours_that_are_seen_stay(mosaic):
    x = noise(1, 2, 8, 10)
    np.testing.assert_allclose(mosaic.sample(mosaic.demosaic(planes(x))), x, atol=1e-12)


@given(mosaic=patterns, colour=st.tuples(*[st.floats(0, 1)] * 3))
def test_a_constant_colour_stays(mosaic, colour):
    video = np.broadcast_to(colour, (1, 1, 6, 8, 3))
    np.testing.assert_allclose(mosaic.demosaic(planes(mosaic.sample(video))), video, atol=1e-12)


@given(mosaic=patterns, slopes=st.lists(st.floats(-1, 1), min_size=6, max_size=6))
def test_linear_ramps_are_exact(mosaic, slopes):
    """Of each colour another one, but at the edges, where neighbours are missing."""
    down, right = np.reshape(slopes, (2, 3))
    i, j = np.mgrid[:16, :16][..., None]
    video = (0.5 + down * i + right * j)[None, None]
    back = mosaic.demosaic(planes(mosaic.sample(video)))
    inside = (..., slice(4, -4), slice(4, -4), slice(None))
    np.testing.assert_allclose(back[inside], video[inside], atol=1e-10)


def test_chroma_has_the_noise_of_a_pixel_at_most():
    x = np.random.default_rng(0).standard_normal((1, 1, 256, 256))
    luma, chroma = Mosaic("RGGB").split(x)
    assert 0.6 < luma.std() < 1
    assert 0.4 < chroma.std() < 1


@every_pattern
def test_gains_are_those_of_the_colours(mosaic):
    grey, gains = 0.2 + 0.6 * noise(1, 4, 32, 32), np.array([0.3, 1, 0.6])
    op = SensingOperator(planes(noise(1, 4, 32, 32, seed=1) < 0.5))
    y = op.forward(planes(mosaic.sample(grey[..., None] * gains)))
    np.testing.assert_allclose(mosaic.gains(y, op), gains, rtol=0.05)
    assert np.array_equal(mosaic.gains(0 * y, op), np.ones(3))


def test_a_colour_that_is_missing_is_not_raised_without_bound():
    op = SensingOperator(np.ones((1, 1, 8, 8)))
    y = planes(Mosaic("RGGB").sample(np.ones((8, 8, 3)) * [1, 1, 0]))
    assert 0 < Mosaic("RGGB").gains(y, op)[2] < 0.1


def test_simulate_is_that_of_the_mosaic():
    video, masks = noise(2, 3, 8, 8, 3), noise(2, 3, 8, 8, seed=1) < 0.5
    y = simulate(video, masks, mosaic="GBRG")
    np.testing.assert_allclose(y, simulate(Mosaic("GBRG").sample(video), masks), rtol=1e-6)


def test_errors_name_the_argument():
    with pytest.raises(InputError, match="mosaic is 'RGB': one of these was expected: RGGB"):
        Mosaic("RGB")
    with pytest.raises(InputError, match=r"video has shape \(1, 2, 7, 8\): even rows"):
        simulate(noise(1, 2, 7, 8, 3), np.ones((1, 2, 7, 8)), mosaic="RGGB")
    with pytest.raises(InputError, match=r"\(1, 2, 8, 8, 3\) in colour was expected"):
        simulate(noise(1, 2, 8, 8), np.ones((1, 2, 8, 8)), mosaic="RGGB")


def test_other_pictures_and_objects_are_refused():
    with pytest.raises(InputError, match=r"video has shape \(4, 4\).*rows, columns, 3"):
        Mosaic("RGGB").sample(np.ones((4, 4)))
    with pytest.raises(InputError, match=r"picture has shape \(2,\)"):
        planes([1, 2])
    with pytest.raises(InputTypeError, match="prior is 'tv': Prior was expected"):
        Mosaicked("tv", "RGGB")
