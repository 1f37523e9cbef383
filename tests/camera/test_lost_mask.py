"""A mask at an end that is missing: told by the light of the frame that it coded."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

import pnp_sci
from pnp_sci.camera.lost_mask import step_of

SIDE = 96


def scene_of(frames, views=2, seed=0):
    """A texture (V, B, H, W) that moves, from 0 to 1."""
    texture = gaussian_filter(np.random.default_rng(seed).random((views, SIDE, SIDE)), (0, 2, 2), mode="wrap")
    texture = (texture - texture.min()) / np.ptp(texture)
    return np.stack([np.roll(texture, 2 * b, -1) for b in range(frames)], 1)


def measured(views, frames, step, noise=0.0, seed=0):
    """Masks that move, and what they show of a textured scene that moves."""
    truth = scene_of(frames, views, seed)
    masks = pnp_sci.moving_masks(truth.shape, step=step, seed=seed)
    return masks, pnp_sci.simulate(truth, masks, noise, seed=seed)


def told(y, masks):
    return [finding.text for finding in pnp_sci.check_fit(y, masks).findings if finding.kind == "missing"]


@pytest.mark.parametrize(("views", "frames"), [(1, 3), (1, 8), (2, 10), (1, 20)])
@pytest.mark.parametrize("step", [(1, -1), (0, 12), (-3, 0)])
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
    bad = np.random.default_rng(1).random(y.shape) < 0.25
    y[bad] = np.nan
    for given, kinds in ((masks, []), (masks[:, :-1], ["missing"])):
        fit = pnp_sci.check_fit(y, 7.5 * given, bad=bad)
        assert [finding.kind for finding in fit.findings if finding.kind == "missing"] == kinds


def test_bad_pixels_are_not_looked_at():
    """Here they are mostly those that one more mask would leave dark, and 0."""
    masks = pnp_sci.moving_masks((1, 9, SIDE, SIDE), step=(1, -1))
    y = pnp_sci.simulate(scene_of(8, 1), masks[:, :-1])
    bad = (masks[0, -1] == 0) & (np.random.default_rng(0).random(y.shape) < 0.6)
    fit = pnp_sci.check_fit(y, masks[:, :-1], bad=bad)
    assert [finding.kind for finding in fit.findings if finding.kind == "missing"] == []


def test_sides_that_the_known_masks_do_not_cover_are_not_looked_at():
    """Nearly all light is there, and the step does not tell what the missing mask has there."""
    truth = scene_of(4, 1)
    truth[..., 12:] /= 20
    masks = pnp_sci.moving_masks(truth.shape, step=(0, 12), seed=0)
    assert told(pnp_sci.simulate(truth, masks), masks[:, :-1]) == ["y follows one more mask, after the last one"]


@pytest.mark.parametrize("step", [(1, -1), (0, 2)])
def test_masks_that_are_off_by_a_step_are_all_there(step):
    masks, y = measured(1, 8, step)
    for off in (1, -1):
        assert told(y, np.roll(masks, np.multiply(off, step), (2, 3))) == []


def test_masks_that_come_again_do_not_tell():
    """Each frame follows the last one: the next mask is the first."""
    pattern = np.tile(np.random.default_rng(0).random((SIDE, 8)) < 0.5, (1, SIDE // 8))
    masks = np.stack([np.roll(pattern, b, 1) for b in range(8)])[None]
    scene = gaussian_filter(np.random.default_rng(1).random((SIDE, SIDE)), 2)
    assert step_of(masks[0]).tolist() == [0, 1]
    assert told(pnp_sci.simulate(np.broadcast_to(scene, masks.shape), masks), masks) == []


def test_one_view_may_lack_its_mask():
    masks, y = measured(2, 9, (1, -1))
    one = pnp_sci.moving_masks((2, 9, SIDE, SIDE), step=(1, -1), seed=0)[:, :-1]
    first_only = y - pnp_sci.simulate(np.where(np.arange(9)[:, None, None] < 8, 0, scene_of(9))[1:], masks[1:])
    assert told(first_only, one) == ["y follows one more mask, after the last one"]


@pytest.mark.parametrize("make", ["random", "still", "backwards and forwards", "changing"])
def test_other_masks_have_no_step(make):
    masks = pnp_sci.moving_masks((1, 6, SIDE, SIDE))[0]
    others = {"random": pnp_sci.random_masks((1, 6, SIDE, SIDE))[0], "still": masks[:1].repeat(6, 0)}
    others["changing"] = np.where(np.random.default_rng(2).random(masks.shape) < 0.1, others["random"], masks)
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
