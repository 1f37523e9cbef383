"""Mosaics of colour sensors: nothing is lost in planes, luma and chroma; priors gain by them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci.errors import InputError
from pnp_sci.sensing.mosaic import PATTERNS, interleaved
from pnp_sci.testing import check_prior

EVEN = (1, 2, 8, 12), (2, 3, 34, 36)


@given(seed=st.integers(0, 99), rows=st.integers(1, 9), columns=st.integers(1, 9), pattern=st.sampled_from(PATTERNS))
def test_luma_and_chroma_hold_all_of_a_mosaic(seed, rows, columns, pattern):
    x = np.random.default_rng(seed).random((2, 3, 2 * rows, 2 * columns))
    mosaic = pnp_sci.Mosaic(pattern)
    np.testing.assert_allclose(mosaic.join(*mosaic.split(x)), x, atol=1e-12)
    np.testing.assert_array_equal(interleaved(pnp_sci.planes(x)), x)
    sampled = mosaic.sample(mosaic.demosaic(x))
    np.testing.assert_allclose(pnp_sci.planes(sampled), x, atol=1e-12)


@pytest.mark.parametrize("pattern", PATTERNS)
def test_one_colour_and_grey_ramps_come_back(pattern):
    mosaic, colour = pnp_sci.Mosaic(pattern), np.array([0.2, 0.5, 0.9])
    flat = np.broadcast_to(colour, (1, 2, 8, 10, 3))
    np.testing.assert_allclose(mosaic.demosaic(pnp_sci.planes(mosaic.sample(flat))), flat, atol=1e-12)
    steps = (np.arange(16)[:, None] + 2 * np.arange(24)) / 64
    grey = np.broadcast_to(steps[..., None], (1, 1, 16, 24, 3))
    inside = (..., slice(4, -4), slice(4, -4), slice(None))
    np.testing.assert_allclose(mosaic.demosaic(pnp_sci.planes(mosaic.sample(grey)))[inside], grey[inside], atol=1e-9)


def test_wrapped_priors_keep_the_promises_of_priors():
    mosaic = pnp_sci.Mosaic("GRBG")
    for name in ("tv", "wavelet"):
        check_prior(pnp_sci.Mosaicked(pnp_sci.as_prior(name), mosaic), shapes=EVEN)


def test_it_is_better_than_plane_by_plane_and_than_grey():
    from skimage.data import astronaut

    picture = astronaut()[20:148, 150:278].astype(np.float32) / 255
    truth = np.stack([np.roll(picture, (0, 2 * b), (0, 1)) for b in range(6)])[None]
    mosaic, masks = pnp_sci.Mosaic("RGGB"), pnp_sci.random_masks(truth.shape[:4], seed=1)
    y = pnp_sci.simulate(mosaic.sample(truth), masks)
    options = {"init": "adjoint", "scene": "full", "noise": 0.0}
    in_planes = pnp_sci.planes(y), pnp_sci.planes(masks)

    def score(x):
        return -10 * np.log10(np.mean((mosaic.demosaic(x) - truth) ** 2))

    wrapped = score(pnp_sci.solve(*in_planes, pnp_sci.Mosaicked(pnp_sci.as_prior("tv"), mosaic), **options).x)
    assert wrapped > score(pnp_sci.solve(*in_planes, "tv", **options).x) + 0.5
    assert wrapped > score(pnp_sci.planes(pnp_sci.solve(y, masks, "tv", **options).x)) + 2


def test_errors_name_the_argument():
    with pytest.raises(InputError, match="mosaic is 'RGBG'"):
        pnp_sci.Mosaic("RGBG")
    with pytest.raises(InputError, match=r"picture has shape \(5, 4\)"):
        pnp_sci.planes(np.ones((5, 4)))
