"""What is modelled follows what the scene requires."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SceneModel, SensingOperator, datasets, solve
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.plugins import registry
from pnp_sci.scene.select import (
    CAREFULLY,
    SURELY,
    TILE,
    _at_most,
    _beyond_chance,
    _contested_tile,
    _evidence,
    view_levels,
)
from priors.flow import Flow


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(128)


@pytest.fixture(scope="module")
def still(scene):
    return np.repeat(scene.truth[:, :1], scene.truth.shape[1], axis=1)


def psnr(result, truth):
    return float(np.mean(pnp_sci.psnr(result.x, truth)))


def test_a_moving_scene_is_modelled_in_full(scene):
    result = solve(scene.y, scene.masks, iterations=2)
    assert result.scene["views"] == (True, True)
    assert not result.scene["still"]
    assert result.scene["frames_modelled"] == result.scene["frames"] == 20


def test_a_still_scene_needs_one_frame_a_view(scene, still):
    y = pnp_sci.simulate(still, scene.masks)
    auto, full = solve(y, scene.masks), solve(y, scene.masks, scene="full")
    assert auto.scene["still"]
    assert auto.scene["frames_modelled"] == 2
    assert (auto.x == auto.x[:, :1]).all()
    assert psnr(auto, still) > psnr(full, still) + 2


def test_a_dark_view_is_dropped(scene):
    truth = scene.truth.copy()
    truth[1] = 0
    y = pnp_sci.simulate(truth, scene.masks)
    auto, full = solve(y, scene.masks), solve(y, scene.masks, scene="full")
    assert auto.scene["views"] == (True, False)
    assert "view 2 is dark" in auto.scene["reason"]
    assert not auto.x[1].any()
    assert pnp_sci.psnr(auto.x, truth)[0] > pnp_sci.psnr(full.x, truth)[0] + 0.5


def test_flow_contradicts_where_tv_makes_too_little_of_a_moving_scene(monkeypatch):
    """Through sparse masks a still model is as good as TV, but not as good as what motion tells."""
    first = datasets.embedded_scene(64).truth[:, 0]
    truth = np.stack([np.roll(first, (b, b // 2), (1, 2)) for b in range(10)], axis=1)
    masks = pnp_sci.random_masks(truth.shape, 0.1)
    y = pnp_sci.simulate(truth, masks)
    assert not solve(y, masks, "flow", iterations=1).scene["still"]
    moving, frozen = (solve(y, masks, "flow", scene=model) for model in ("auto", SceneModel((True, True), True)))
    assert psnr(moving, truth) > psnr(frozen, truth)
    monkeypatch.setattr(
        "pnp_sci.scene.select._at_most", lambda share, *errors: share == CAREFULLY or _at_most(share, *errors)
    )
    monkeypatch.setattr("pnp_sci.scene.select._evidence", lambda *given: 0.0)
    assert solve(y, masks, "flow", iterations=1).scene["still"], "but for what flow says"


@pytest.mark.parametrize("side", [24, 31])
def test_a_picture_too_small_for_flow_is_judged_as_strictly_as_by_tv(side):
    """`flow` would leave the full model to TV: nothing could contradict."""
    whole = datasets.embedded_scene(64).truth
    for top, left in ((0, 0), (12, 20), (30, 8), (33, 33)):
        truth = whole[:, :, top : top + side, left : left + side]
        masks = pnp_sci.random_masks(truth.shape, seed=1)
        y = pnp_sci.simulate(truth, masks)
        by_flow, by_tv = (solve(y, masks, prior, iterations=1).scene["still"] for prior in ("flow", "tv"))
        assert by_flow == by_tv


def test_flow_may_find_a_still_scene_that_tv_leaves_open(monkeypatch, scene, still):
    y = pnp_sci.simulate(still, scene.masks)
    monkeypatch.setattr("pnp_sci.scene.select.CLEARLY", 0.0)
    assert not solve(y, scene.masks, "tv", iterations=1).scene["still"]
    assert solve(y, scene.masks, "flow", iterations=1).scene["still"]


def test_flow_is_asked_with_the_options_that_the_limits_are_for(monkeypatch, scene, still):
    made = []

    def recorded(**options):
        made.append(options)
        return Flow(**options)

    monkeypatch.setitem(registry._registered["priors"], "flow", recorded)
    assert solve(pnp_sci.simulate(still, scene.masks), scene.masks, "bm3d", iterations=1).scene["still"]
    assert {(options["neighbours"], options["tolerance"], options["still"]) for options in made} == {(2, 3.0, False)}


@pytest.mark.parametrize("noise", [0.05, 0.1])
def test_noise_does_not_freeze_a_moving_scene(noise):
    scene = datasets.embedded_scene(128)
    y = pnp_sci.simulate(scene.truth, scene.masks, noise=noise)
    assert not solve(y, scene.masks, "flow", iterations=1).scene["still"]


@pytest.mark.parametrize("prior", ["tv", "flow"])
def test_something_small_and_faint_that_moves_is_not_frozen(prior):
    rows, columns = np.mgrid[:96, :96] / 96
    truth = np.repeat(np.stack([0.3 + 0.4 * rows, 0.6 - 0.3 * columns])[:, None], 10, axis=1).astype(np.float32)
    for b in range(10):
        truth[0, b, 40:48, 30 + 3 * b : 38 + 3 * b] += 0.2
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    found = solve(pnp_sci.simulate(truth, masks), masks, prior, iterations=1).scene["still"]
    assert found in (False, (False, True)), "the second view does stand still"


def test_a_view_that_stands_still_beside_a_moving_one(scene, still):
    truth = np.stack([scene.truth[0], still[1]])
    y = pnp_sci.simulate(truth, scene.masks)
    told, full = (solve(y, scene.masks, scene=m) for m in (SceneModel((True, True), (False, True)), "full"))
    assert told.scene["still"] == (False, True)
    assert told.scene["frames_modelled"] == 11
    assert (told.x[1] == told.x[1, :1]).all()
    assert np.ptp(told.x[0], axis=0).max() > 0.1
    assert pnp_sci.psnr(told.x, truth)[1] > pnp_sci.psnr(full.x, truth)[1] + 0.5


def test_a_still_view_beside_a_moving_one_is_found_by_thorough_priors(scene, still):
    for frozen in (0, 1):
        truth = np.stack([still[v] if v == frozen else scene.truth[v] for v in (0, 1)])
        y = pnp_sci.simulate(truth, scene.masks)
        found = solve(y, scene.masks, "flow")
        full, moving = (solve(y, scene.masks, "flow", scene="full", still=still) for still in (True, False))
        assert found.scene["still"] == (frozen == 0, frozen == 1)
        assert f"shows of view {frozen + 1}" in found.scene["reason"]
        assert psnr(found, truth) > psnr(moving, truth) + 0.5
        assert psnr(full, truth) > psnr(moving, truth), "pixel by pixel some of it is found as well"
        assert full.scene["at_rest"][frozen] > 1.5 * full.scene["at_rest"][1 - frozen]
        assert isinstance(solve(y, scene.masks, "tv", iterations=1).scene["still"], bool), "tv looks for none"


@pytest.mark.parametrize("prior", ["tv", "flow"])
@pytest.mark.parametrize("brightness", [(1, 0.5), (1, 0.1), (0.1, 1), (1, 0.05)])
def test_dim_views_that_move_are_neither_frozen_nor_left_out(scene, prior, brightness):
    truth = scene.truth * np.array(brightness, np.float32)[:, None, None, None]
    y = pnp_sci.simulate(truth, scene.masks)
    model = solve(y, scene.masks, prior, iterations=1).scene
    assert model["frames_modelled"] == model["frames"], model["reason"]


def test_evidence_counts_standard_errors_of_what_is_shown():
    """Like noise where errors have nothing of it, whatever their size from place to place, and of either view."""
    rng = np.random.default_rng(0)
    hidden = rng.random((60, 60)) < 0.1
    chance = []
    for _ in range(200):
        shown, errors = rng.standard_normal((2, 60, 60)), rng.standard_normal((60, 60)) * rng.random((60, 60)) ** 3
        chance.append(_evidence(errors, shown, hidden))
        assert _evidence(1e6 * errors, 1e-6 * shown, hidden) == pytest.approx(chance[-1])
        assert _evidence(errors + shown[0], shown, hidden) > 5
        assert _evidence(errors + shown[1], shown, hidden) > 5
        assert _evidence(errors - shown[1], shown[1:], hidden) == 0, "the other way round nothing speaks for it"
    assert 0.2 < np.mean(chance) < 0.9  # of the larger of two normal variables, or 0
    assert np.mean(np.array(chance) > 2.5) < 0.05
    assert _evidence(errors, 0 * shown, hidden) == 0


def test_a_gain_beyond_chance_is_two_standard_errors():
    noise = np.random.default_rng(0).standard_normal(1000)
    noise -= noise.mean()
    error = noise.std() / np.sqrt(1000)
    assert _beyond_chance(np.ones(1000), 1 + noise + 1.1 * SURELY * error)
    assert not _beyond_chance(np.ones(1000), 1 + noise + 0.9 * SURELY * error)
    assert not _beyond_chance(np.ones(1000), np.ones(1000)), "no gain at all"
    assert not _beyond_chance(-np.ones(1000), noise - 0.1), "all noise"


def test_one_answer_or_one_for_each_view():
    assert SceneModel((True, True), True) == SceneModel((1, 1), (1, 1))
    assert SceneModel((True, False), (True, False)).nothing_moves  # of what there is
    assert SceneModel((True, True), (False, False)).complete
    with pytest.raises(InputError, match="still has 1 values: 2 were expected"):
        SceneModel((True, True), (True,))
    with pytest.raises(InputTypeError, match="still is 7"):
        SceneModel((True, True), 7)


def test_flow_agrees_where_nothing_moves(scene, still):
    assert solve(pnp_sci.simulate(still, scene.masks), scene.masks, "flow", iterations=1).scene["still"]


def test_models_are_compared_where_the_simple_one_is_worst_off_not_where_errors_are_largest():
    rng = np.random.default_rng(0)
    unseen = rng.random((256, 300)) < 0.1
    other = unseen * rng.random(unseen.shape)
    other[:120] *= 100  # fine texture, which both models predict badly
    simple = 0.6 * other
    simple[190:230, 220:270] *= 4  # something moves
    rows, columns = _contested_tile(simple, other)
    assert rows.stop - rows.start == columns.stop - columns.start == TILE
    assert rows.start <= 190 < 230 <= rows.stop
    assert columns.start <= 220 < 270 <= columns.stop


@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (47, 48), (97, 95)])
def test_a_small_picture_is_compared_as_far_as_it_goes(shape):
    errors = np.random.default_rng(0).random(shape)
    for some in (errors, np.zeros(shape)):
        part = errors[_contested_tile(some, errors[::-1])]
        assert part.shape == tuple(min(TILE, n) for n in shape)


def test_several_measurements_are_judged_apart(scene, still):
    y = np.stack([scene.y, pnp_sci.simulate(still, scene.masks)])
    judged = solve(y, scene.masks, iterations=2).scene["measurements"]
    assert [s["still"] for s in judged] == [False, True]


def test_a_model_by_hand(scene):
    result = solve(scene.y, scene.masks, scene=SceneModel((True, False)), iterations=5)
    assert not result.x[1].any()
    assert result.x[0].any()


def test_views_are_no_indices(scene):
    assert SceneModel((1, 0)).views == (True, False)  # type: ignore[arg-type]
    with pytest.raises(InputTypeError, match="views is 3"):
        SceneModel(3)  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", ["half", 3, SceneModel((True,)), SceneModel((False, False))])
def test_errors_name_the_scene(scene, bad):
    with pytest.raises(InputError, match="scene"):
        solve(scene.y, scene.masks, scene=bad)


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_empty_scenes_have_a_model(scene, value):
    assert np.isfinite(solve(np.full_like(scene.y, value), scene.masks).x).all()


def test_a_view_that_is_not_dropped_stays_in_the_still_model(monkeypatch, scene):
    """A dim second view passes for dark by its level; if y says otherwise it must not vanish by the back door."""
    truth = scene.truth * np.array([1, 0.01], np.float32)[:, None, None, None]
    y = pnp_sci.simulate(truth, scene.masks)
    monkeypatch.setattr("pnp_sci.scene.select._Comparison.__call__", lambda _, simple, *rest: simple.nothing_moves)
    assert solve(y, scene.masks, iterations=1).scene["views"] == (True, True)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_views_that_cannot_be_told_apart_share_the_light(dtype):
    """Masks that are multiples of each other: no view may look dark for rounding alone."""
    random = np.random.default_rng(1)
    masks = random.random((1, 4, 256, 256))
    op = SensingOperator(np.concatenate([masks, 1.09 * masks]).astype(dtype), dtype)
    y = op.forward(np.full(op.shape, 0.5, dtype)) + 0.05 * random.standard_normal((256, 256)).astype(dtype)
    first, second = view_levels(op, y)
    assert second / first == pytest.approx(1.09, abs=1e-2)


def test_what_stands_still_is_said_of_each_view(scene):
    """Of a dark view nothing is known, nor of one that is modelled by one frame, nor by priors that do not look."""
    for model, known in (
        (SceneModel((False, True)), (False, True)),
        (SceneModel((True, True), (True, False)), (False, True)),
        (SceneModel((True, True), True), (False, False)),
        (SceneModel((True, True)), (True, True)),
    ):
        y = np.stack([scene.y, 0.9 * scene.y])
        for one in solve(y, scene.masks, "tv", scene=model, iterations=41).scene["measurements"]:
            assert [part is not None for part in one["at_rest"]] == list(known)
    assert solve(scene.y, scene.masks, "wavelet", scene="full", iterations=1).scene["at_rest"] == [None, None]
    joint = solve(scene.y, scene.masks, "wavelet+tv", scene="full", iterations=41, tol=0)
    assert all(0 <= part < 1 for part in joint.scene["at_rest"])
