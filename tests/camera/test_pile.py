"""A camera that is saturated is noticed, wherever its values pile up."""

import numpy as np
import pytest

from pnp_sci import Sensor, check_fit, datasets, simulate


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


@pytest.fixture(scope="module")
def counts(scene):
    """12-bit values of a camera that saturates at 55 % of the largest light."""
    clean = simulate(scene.truth, scene.masks)
    noise = np.random.default_rng(0).normal(0, 4, clean.shape)
    return np.clip(np.round(clean * 4095 / (0.55 * clean.max()) + noise), 0, 4095)


def piles(y, masks, noise="auto"):
    return [finding.hint for finding in check_fit(y, masks, noise=noise).findings if finding.kind == "saturation"]


@pytest.mark.parametrize("shift", [1, 16])
@pytest.mark.parametrize(("full_scale", "bits"), [(65535, 12), (65535, 16), (70000, None)])
def test_a_full_scale_that_is_never_reached_is_remarked_upon(scene, counts, shift, full_scale, bits):
    (hint,) = piles(counts * shift, scene.masks, Sensor(full_scale=full_scale, bits=bits))
    assert f"full_scale={4095 * shift})" in hint
    assert not piles(counts * shift, scene.masks, Sensor(full_scale=4095 * shift))


@pytest.mark.parametrize("spread", [1, 6, 30])
def test_a_dark_frame_per_pixel_does_not_hide_the_pile(scene, counts, spread):
    dark = np.random.default_rng(1).normal(64, spread, counts.shape)
    with_dark = np.clip(np.round(counts + dark), 0, 4095)
    y, reached = with_dark - dark, with_dark == 4095
    fit = check_fit(y, scene.masks)
    found = y >= fit.full_scale
    assert found[reached].mean() > 0.9
    assert found.sum() < 1.2 * reached.sum()
    assert not piles(y, scene.masks, Sensor(full_scale=fit.full_scale))


def test_values_above_the_full_scale_are_remarked_upon(scene, counts):
    (finding,) = check_fit(16 * counts, scene.masks, noise=Sensor(full_scale=4095)).findings
    assert finding.text == "y reaches 65520, but the full scale is 4095"


def test_a_pile_that_is_known_in_part_only_is_remarked_upon(scene, counts):
    dark = np.random.default_rng(1).normal(64, 6, counts.shape)
    assert piles(np.clip(np.round(counts + dark), 0, 4095) - dark, scene.masks, Sensor(full_scale=4095 - 64))


def test_hot_pixels_do_not_hide_the_pile(scene, counts):
    y = counts.copy()
    y[::20, ::20] = 65535
    assert "full_scale=4095)" in piles(y, scene.masks)[0]


def test_white_parts_of_a_scene_are_no_pile(scene):
    film = np.clip(scene.truth * 3, 0, 1)
    for masks in (scene.masks, scene.masks[:1, :1], scene.masks[:1, :2]):
        assert not piles(simulate(film[: len(masks), : masks.shape[1]], masks, bits=8), masks)


def test_saturation_is_not_taken_for_a_black_level(scene, counts):
    assert {finding.kind for finding in check_fit(counts, scene.masks).findings} == {"saturation"}
