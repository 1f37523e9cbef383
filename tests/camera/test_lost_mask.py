"""A mask at an end that is missing: told by the light of the frame that it coded."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.camera.lost_mask import step_of

SIDE = 96


def measured(views, frames, step, noise=0.0, seed=0):
    """Masks that move, and what they show of a textured scene that moves."""
    texture = gaussian_filter(np.random.default_rng(seed).random((views, SIDE, SIDE)), (0, 2, 2), mode="wrap")
    texture = (texture - texture.min()) / np.ptp(texture)
    truth = np.stack([np.roll(texture, 2 * b, -1) for b in range(frames)], 1)
    masks = pnp_sci.moving_masks(truth.shape, step=step, seed=seed)
    return masks, pnp_sci.simulate(truth, masks, noise, seed=seed)


def told(y, masks):
    return [finding.text for finding in pnp_sci.check_fit(y, masks).findings if finding.kind == "missing"]


@pytest.mark.parametrize(("views", "frames"), [(1, 3), (1, 8), (2, 10), (1, 20)])
@pytest.mark.parametrize("step", [(1, -1), (0, 2), (-3, 0)])
@pytest.mark.parametrize("noise", [0, 0.05])
def test_the_end_is_named(views, frames, step, noise):
    masks, y = measured(views, frames + 1, step, noise)
    assert told(y, masks) == []
    assert told(y, masks[:, :-1]) == ["y follows one more mask, after the last one"]
    assert told(y, masks[:, 1:]) == ["y follows one more mask, before the first one"]


def test_of_pictures_larger_than_the_part_that_is_looked_at(monkeypatch):
    monkeypatch.setattr("pnp_sci.camera.lost_mask.SIDE", 64)
    masks, y = measured(1, 8, (1, -1))
    assert told(y, masks) == []
    assert told(y, masks[:, :-1]) == ["y follows one more mask, after the last one"]


def test_whatever_the_type_of_the_masks_and_bad_pixels():
    masks, y = measured(1, 8, (1, -1))
    y[20:30, 40:50] = np.nan
    fit = pnp_sci.check_fit(y, 7.5 * masks[:, :-1], bad=np.isnan(y))
    assert "missing" in [finding.kind for finding in fit.findings]


@pytest.mark.parametrize("make", ["random", "still", "backwards and forwards"])
def test_other_masks_have_no_step(make):
    masks = pnp_sci.moving_masks((1, 6, SIDE, SIDE))[0]
    others = {"random": pnp_sci.random_masks((1, 6, SIDE, SIDE))[0], "still": masks[:1].repeat(6, 0)}
    assert step_of(masks).tolist() == [1, -1]
    assert step_of(others.get(make, masks[[0, 1, 2, 1, 0, 1]])) is None


def test_views_may_move_apart():
    one, other = (
        pnp_sci.moving_masks((1, 8, SIDE, SIDE), step=step, seed=k) for k, step in enumerate([(1, 0), (0, -2)])
    )
    masks = np.concatenate([one, other])
    truth = np.broadcast_to(gaussian_filter(np.random.default_rng(0).random((SIDE, SIDE)), 2), masks.shape)
    y = pnp_sci.simulate(truth, masks)
    assert told(y, masks) == []
    assert told(y, masks[:, 1:]) == ["y follows one more mask, before the first one"]
