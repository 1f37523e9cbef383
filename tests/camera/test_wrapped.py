"""Sums that were stored in too narrow a type are named, and nothing else is taken for them."""

import os
from pathlib import Path

import numpy as np
import pytest

from pnp_sci import check_fit, datasets, io, moving_masks, random_masks, solve

DATA = os.environ.get("PNP_SCI_DATA")
TIMES = [1.3, 1.6, 2, 3, 4, 5, 7, 10]  # of the period: what the largest sum is


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


def kinds(y, masks, **options):
    return [finding.kind for finding in check_fit(y, masks, **options).findings]


def sums(scene, masks):
    """The measurement of the scene, whose largest value is 1."""
    views, frames = masks.shape[:2]
    y = np.einsum("vbhw,vbhw->hw", masks.astype("f8"), scene.truth[:views, :frames])
    return y / y.max()


MASKS = {
    "two views": lambda scene: scene.masks,
    "one view": lambda scene: scene.masks[:1],
    "random": lambda scene: random_masks(scene.masks.shape, seed=1),
    "four frames": lambda scene: random_masks((1, 4, 128, 128), seed=2),
    "grey": lambda scene: np.random.default_rng(0).uniform(0, 1, (1, 8, 128, 128)),
    "of uint8": lambda scene: 255 * moving_masks((1, 6, 128, 128), 0.3, seed=3).astype(np.uint8),
}


@pytest.mark.parametrize("name", MASKS)
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_sums_that_have_wrapped_are_named(scene, name, dtype):
    masks, period = MASKS[name](scene), np.iinfo(dtype).max + 1
    y = sums(scene, masks)
    y = np.maximum(y + np.random.default_rng(0).normal(0, 0.005, y.shape), 0)
    found = []
    for times in TIMES:
        stored = (y * times * period).astype(np.int64).astype(dtype)
        fit = check_fit(stored if times % 2 else stored.astype(np.float32), masks)
        found.append([finding.kind for finding in fit.findings] == ["wrapped"])
        assert not found[-1] or (not fit.bad.any() and f"wrapped around at {period}" in fit.warnings[0])
    assert all(found[2:]), found


CHANGES = {
    "right": lambda y, d: y,
    "noise": lambda y, d: y + np.random.default_rng(1).normal(0, 0.3 * y.mean(), y.shape),
    "saturated": lambda y, d: 2 * y,
    "far saturated": lambda y, d: 4 * y,
    "gamma": lambda y, d: y**0.45,
    "black level": lambda y, d: 0.6 * y + 0.4,
    "dead": lambda y, d: np.where(d < 0.02, 0, y),
    "dead and hot": lambda y, d: np.where(d < 0.1, 10 * d, y),
    "dark and hot": lambda y, d: np.where(d < 0.02, 1, 0.1 * y),
    "dust": lambda y, d: np.where(d < 0.02, 20 * d, 0.4 + 0.6 * y),
}


@pytest.mark.parametrize(("name", "top"), [("two views", 255), ("random", 65535), ("four frames", 255), ("grey", 255)])
def test_what_reaches_the_largest_number_has_not_wrapped(scene, name, top):
    masks = MASKS[name](scene)
    y, d = sums(scene, masks), np.random.default_rng(0).random(masks.shape[2:])
    others = {"right": masks, "upside down": masks[:, :, ::-1], "of another setup": random_masks(masks.shape, seed=7)}
    others |= {"inverted": masks.max() - np.asarray(masks, "f4"), "a pixel off": np.roll(masks, 1, 3)}
    for change in CHANGES.values():
        stored = np.floor(top * np.clip(change(y, d), 0, 1))
        assert not [which for which, other in others.items() if "wrapped" in kinds(stored, other)]


def test_nothing_is_left_out_of_what_has_wrapped(scene):
    y = (sums(scene, scene.masks[:1]) * 1.6 * 256).astype(np.int64).astype(np.uint8)
    result = solve(y, scene.masks[:1], bad="auto", iterations=1)
    assert result.scene["bad"] == 0
    assert "wrapped around at 256" in result.remarks[0]


@pytest.mark.skipif(DATA is None, reason="set PNP_SCI_DATA to the folder with the captures")
@pytest.mark.parametrize("file", ["4hand14_cacti.mat", "6fan14_cacti.mat"])
def test_real_captures_have_not_wrapped(file):
    y, masks = (read(Path(DATA) / "real" / file) for read in (io.read_measurement, io.read_masks))
    for one in y if y.ndim == 3 else y[None]:
        for stored in (one, np.floor(255 * one / one.max()), np.floor(65535 * one / one.max())):
            assert "wrapped" not in kinds(stored, masks)
