"""Large pictures in tiles: every pixel once, as if in one piece, without a seam."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pnp_sci
from pnp_sci import solve
from pnp_sci.pipeline import tiles as module
from pnp_sci.pipeline.tiles import MARGIN, tiles


@given(rows=st.integers(1, 900), columns=st.integers(1, 900), side=st.integers(1, 1000))
def test_every_pixel_is_in_one_tile(rows, columns, side):
    found, most = tiles((2, 3, rows, columns), 6 * side**2), 6 * side**2
    count = np.zeros((rows, columns), int)
    for tile in found:
        count[tile.kept] += 1
        assert all(s.start <= k.start <= k.stop <= s.stop for s, k in zip(tile.seen, tile.kept))
        inner = np.empty((rows, columns))[tile.seen][tile.inner]
        assert inner.shape == count[tile.kept].shape
        if side > 4 * MARGIN + 16:
            assert count[tile.seen].size * 6 <= 1.1 * most
    assert (count == 1).all()


@pytest.fixture
def large(monkeypatch):
    """A scene of 2 x 10 frames of 384 x 384, which takes four tiles here."""
    scene = pnp_sci.datasets.embedded_scene(256)
    truth = np.pad(scene.truth, ((0, 0), (0, 0), (0, 128), (0, 128)), mode="reflect")
    masks = pnp_sci.random_masks(truth.shape, seed=5)
    return truth, masks, pnp_sci.simulate(truth, masks), lambda: monkeypatch.setattr(module, "MOST", 20 * 330**2)


def test_there_is_no_seam(large):
    truth, masks, y, limit = large
    options = {"scene": "full", "reference": truth, "iterations": 70}
    whole = solve(y, masks, **options)
    limit()
    parts = solve(y, masks, **options, uncertainty=True)
    np.testing.assert_allclose(pnp_sci.psnr(parts.x, truth), pnp_sci.psnr(whole.x, truth), atol=0.02)
    assert np.abs(parts.x - whole.x).max() > 0, "there were tiles"
    seam = (..., slice(176, 208), slice(None))
    at_seam = [pnp_sci.psnr(x[seam], truth[seam]) for x in (parts.x, whole.x)]
    np.testing.assert_allclose(*at_seam, atol=0.02)
    assert parts.history[-1].iteration == whole.history[-1].iteration
    assert parts.history[-1].psnr == pytest.approx(whole.history[-1].psnr, abs=0.02)
    # each tile has a pace of its own
    assert parts.history[-1].residual < 3 * whole.history[-1].residual
    assert np.isfinite(parts.uncertainty).all()


def test_first_estimates_and_stops_reach_every_tile(large):
    truth, masks, y, limit = large
    limit()
    kept = solve(y, masks, "none", init=truth, iterations=1)
    np.testing.assert_allclose(kept.x, truth, atol=1e-3)
    stopped = solve(y, masks, callback=lambda state: True)
    assert stopped.status is pnp_sci.Status.STOPPED
    assert np.isfinite(stopped.x).all()
