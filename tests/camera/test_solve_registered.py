"""``solve(register=...)``: the masks are moved before anything is solved, and the result says so."""

import json

import numpy as np
import pytest
from moved import moved, seen_through

import pnp_sci
from pnp_sci.errors import InputError, InputTypeError


@pytest.fixture(scope="module")
def off():
    """A scene, its measurement through masks that have moved, with a black level, and those masks."""
    scene = pnp_sci.datasets.embedded_scene(96)
    masks = moved(scene.masks, (0.5, 0.3), order=3).astype(np.float32)
    y = seen_through(masks, scene.truth).astype(np.float32)
    return scene, y + np.float32(0.1 * y.max()), masks


def quality(result, truth):
    return np.mean(pnp_sci.psnr(result.x, truth))


def test_what_is_lost_is_recovered(off):
    scene, y, masks = off
    black = 0.1 / 1.1 * y.max()
    best = pnp_sci.solve(y - black, masks, iterations=40)
    lost = pnp_sci.solve(y, scene.masks, iterations=40)
    mended = pnp_sci.solve(y, scene.masks, iterations=40, register=True)
    gained, loss = (quality(one, scene.truth) - quality(lost, scene.truth) for one in (mended, best))
    assert loss > 3
    assert gained > 0.95 * loss
    assert mended.x.dtype == np.float32
    assert any("register=True" in remark for remark in lost.remarks)
    assert mended.settings["register"] is True
    assert mended.scene["register"]["transforms"][0]["rows"] == pytest.approx(0.5, abs=0.05)
    assert "masks moved by (+0.50, +0.30) pixels" in repr(mended)


def test_a_registration_serves_other_measurements(off, tmp_path):
    scene, y, _ = off
    found = pnp_sci.register(y, scene.masks)
    once = pnp_sci.solve(y, scene.masks, iterations=5, register=True)
    again = pnp_sci.solve(np.stack([y, 2 * y]), scene.masks, iterations=5, register=found)
    assert np.array_equal(again.x[0], once.x)
    assert [json.dumps(one["register"]) for one in again.scenes] == [json.dumps(found.describe())] * 2
    once.save(tmp_path / "result.npz")
    assert pnp_sci.Result.load(tmp_path / "result.npz").scene["register"] == once.scene["register"]
    by_hand = pnp_sci.solve(found.correct(y), found.masks, iterations=5)
    assert np.array_equal(by_hand.x, once.x)


def test_masks_that_fit_change_nothing():
    scene = pnp_sci.datasets.embedded_scene(64)
    plain, registered = (pnp_sci.solve(scene.y, scene.masks, iterations=5, register=r) for r in (False, True))
    assert np.array_equal(plain.x, registered.x)
    assert "masks fit as they are" in repr(registered)


def test_the_full_scale_loses_the_black_level_too(off):
    scene, y, _ = off
    full = float(0.8 * y.max())
    camera = pnp_sci.Sensor(full_scale=full)
    found = pnp_sci.register(y, scene.masks)
    result = pnp_sci.solve(np.minimum(y, full), scene.masks, iterations=2, noise=camera, register=found)
    assert result.scene["saturated"] == np.count_nonzero((y >= full) & found.known)


def test_a_bad_argument_is_named(off):
    scene, y, masks = off
    with pytest.raises(InputTypeError, match="register is 'yes'"):
        pnp_sci.solve(y, scene.masks, register="yes")
    with pytest.raises(InputError, match="register is a registration of other masks"):
        pnp_sci.solve(y, masks, register=pnp_sci.register(y, scene.masks))
