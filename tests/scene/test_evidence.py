"""What speaks for one model of a scene against another."""

import numpy as np
import pytest

from pnp_sci import SensingOperator
from pnp_sci.scene.dark_views import view_levels
from pnp_sci.scene.evidence import at_most, beyond, beyond_chance, contested_tile, evidence
from pnp_sci.sensing.scene_model import SceneModel, full


def test_evidence_counts_standard_errors_of_what_is_shown():
    """Like noise where errors have nothing of it, whatever their size from place to place, and of either view."""
    rng = np.random.default_rng(0)
    hidden = rng.random((60, 60)) < 0.1
    chance = []
    for _ in range(200):
        shown, errors = rng.standard_normal((2, 60, 60)), rng.standard_normal((60, 60)) * rng.random((60, 60)) ** 3
        chance.append(evidence(errors, shown, hidden))
        assert evidence(1e6 * errors, 1e-6 * shown, hidden) == pytest.approx(chance[-1])
        assert evidence(errors + shown[0], shown, hidden) > 5
        assert evidence(errors + shown[1], shown, hidden) > 5
        assert evidence(errors - shown[1], shown[1:], hidden) == 0, "the other way round nothing speaks for it"
    assert 0.2 < np.mean(chance) < 0.9  # of the larger of two normal variables, or 0
    assert np.mean(np.array(chance) > 2.5) < 0.05
    assert evidence(errors, 0 * shown, hidden) == 0


def test_a_gain_beyond_chance_is_some_standard_errors():
    noise = np.random.default_rng(0).standard_normal(1000)
    noise -= noise.mean()
    error = noise.std() / np.sqrt(1000)
    found = [beyond_chance(np.ones(1000), 1 + noise + many * error) for many in (0, 1, 1.5, 3, 4, 9)]
    assert found == [False, False, False, True, True, True]
    assert not beyond_chance(np.ones(1000), np.ones(1000)), "no gain at all"
    assert not beyond_chance(-np.ones(1000), noise - 0.1), "all noise"


def test_errors_at_most_a_share_of_others():
    simple, other = np.full(9, 0.9), np.ones(9)
    assert at_most(1.0, simple, other)
    assert not at_most(0.8, simple, other)
    assert not at_most(1.0, -simple, -other), "of mere noise there is no share"
    assert at_most(1.0, -simple, other)


def test_what_the_simple_model_cannot_show_is_what_is_beyond_it():
    """What moves through masks freed of their mean; nothing of a video that the simple model shows too."""
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random((2, 3, 6, 5)) < 0.5, np.float64)
    still, moving = SceneModel((True, True), True), full(op)
    x = rng.random(op.shape)
    masks = op.masks - op.masks.mean((2, 3), keepdims=True)
    expected = (masks * (x - x.mean(1, keepdims=True))).sum(1)
    np.testing.assert_allclose(beyond(still, moving, op, x), expected, atol=1e-12)
    np.testing.assert_allclose(beyond(still, moving, op, np.repeat(x[:, :1], 3, 1)), 0, atol=1e-12)
    dark = beyond(SceneModel((True, False)), moving, op, x)
    np.testing.assert_allclose(dark[0], 0, atol=1e-12)
    np.testing.assert_allclose(dark[1], (masks * x)[1].sum(0), atol=1e-12)


def test_models_are_compared_where_the_simple_one_is_worst_off_not_where_errors_are_largest():
    rng = np.random.default_rng(0)
    unseen = rng.random((256, 300)) < 0.1
    other = unseen * rng.random(unseen.shape)
    other[:120] *= 100  # fine texture, which both models predict badly
    simple = 0.6 * other
    simple[190:230, 220:270] *= 4  # something moves
    rows, columns = contested_tile(simple, other, 96)
    assert rows.stop - rows.start == columns.stop - columns.start < 200, "a part of the picture"
    assert rows.start <= 190 < 230 <= rows.stop
    assert columns.start <= 220 < 270 <= columns.stop


@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (47, 48), (97, 95), (200, 130)])
@pytest.mark.parametrize("side", [96, 128])
def test_a_small_picture_is_compared_as_far_as_it_goes(shape, side):
    errors = np.random.default_rng(0).random(shape)
    for some in (errors, np.zeros(shape)):
        part = errors[contested_tile(some, errors[::-1], side)]
        assert part.shape == tuple(min(side, n) for n in shape)


def test_a_larger_tile_holds_the_smaller_one():
    errors = np.random.default_rng(0).random((2, 200, 300))
    for within, around in zip(contested_tile(*errors, 96), contested_tile(*errors, 128)):
        assert around.start <= within.start < within.stop <= around.stop


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_views_that_cannot_be_told_apart_share_the_light(dtype):
    """Masks that are multiples of each other: no view may look dark for rounding alone."""
    random = np.random.default_rng(1)
    masks = random.random((1, 4, 256, 256))
    op = SensingOperator(np.concatenate([masks, 1.09 * masks]).astype(dtype), dtype)
    y = op.forward(np.full(op.shape, 0.5, dtype)) + 0.05 * random.standard_normal((256, 256)).astype(dtype)
    first, second = view_levels(op, y)
    assert second / first == pytest.approx(1.09, abs=1e-2)
