"""What is modelled follows what the scene requires."""

import os
from pathlib import Path

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SceneModel, datasets, solve
from pnp_sci.plugins import registry
from pnp_sci.scene import judge as select
from pnp_sci.scene.evidence import at_most
from pnp_sci.training.clips import decoded
from priors.flow import Flow
from priors.tv import TV


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
    moving, frozen = (solve(y, masks, "flow", scene=model) for model in ("auto", SceneModel((True, True), True)))
    assert not moving.scene["still"]
    assert psnr(moving, truth) > psnr(frozen, truth)
    looks = []

    def noted(share, *errors):
        looks.append((share, at_most(share, *errors)))
        return looks[-1][1]

    monkeypatch.setattr(select, "at_most", noted)
    monkeypatch.setattr(select, "evidence", lambda *given: 0.0)
    assert solve(y, masks, "flow", iterations=1).scene["still"] is False
    careful = max(share for share, _ in looks)
    assert [fine for share, fine in looks if share < careful][:2] == [True, True], "TV leaves it open"
    assert False in [fine for share, fine in looks if share == careful], "flow says no"


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
    """Also if TV must predict better than by anything to decide alone."""
    y = pnp_sci.simulate(still, scene.masks)
    monkeypatch.setattr(select, "at_most", lambda share, *errors: share >= 1 and at_most(share, *errors))
    assert not solve(y, scene.masks, "tv", iterations=1).scene["still"]
    assert solve(y, scene.masks, "flow", iterations=1).scene["still"]


def test_what_speaks_for_a_still_scene_is_looked_at_again_on_a_larger_crop(monkeypatch, scene, still):
    y, crops = pnp_sci.simulate(still, scene.masks), []
    holds = select._Comparison._holds

    def noted(self, *given):
        crops.append(given[-1])
        return holds(self, *given) and len(crops) < 2

    monkeypatch.setattr(select._Comparison, "_holds", noted)
    assert solve(y, scene.masks, "tv", iterations=1).scene["still"] is False
    (tile, _), (around, _) = crops
    assert tile.stop - tile.start == 96
    assert around.stop - around.start == 128


def test_what_is_compared_finds_nothing_still_by_itself(monkeypatch, scene, still):
    """Neither TV nor flow may, or both models would show the same; and the limits are those of flow as it is here."""
    made = []

    def recorded(prior):
        class Recorded(prior):
            def __post_init__(self):
                super().__post_init__()
                made.append((prior, self.still, getattr(self, "displace", False), getattr(self, "renew", None)))

        return Recorded

    y = pnp_sci.simulate(still, scene.masks)
    own = {"tv": recorded(TV), "flow": recorded(Flow)}
    monkeypatch.setattr(registry, "installed", lambda kind, name: own[name])
    assert solve(y, scene.masks, "bm3d", iterations=1).scene["still"]
    assert set(made) == {(TV, False, False, None), (Flow, False, False, 4)}


@pytest.mark.skipif(not os.environ.get("PNP_SCI_DATA"), reason="set PNP_SCI_DATA to the folder with the training clips")
@pytest.mark.parametrize("mirrored", [False, True])
def test_fine_texture_that_moves_is_not_taken_for_still(mirrored):
    """On one tile one frame per view predicts as well as flow, by chance; in the video it loses 3 dB."""
    films = Path(os.environ["PNP_SCI_DATA"]) / "train_video"
    parts = (("davis_tennis", 29, 33, 35), ("forest_trek_1", 25, 42, 42))
    views = [decoded(films / f"{name}.mp4")[f : f + 10, t : t + 128, l : l + 128] for name, f, t, l in parts]
    truth = np.stack(views).astype(np.float32) / 255
    masks = pnp_sci.moving_masks(truth.shape, seed=2)
    y, step = pnp_sci.simulate(truth, masks), -1 if mirrored else 1
    assert solve(y[:, ::step], masks[..., ::step], "flow", iterations=1).scene["still"] is False


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
    assert pnp_sci.psnr(told.x, truth)[1] > pnp_sci.psnr(full.x, truth)[1] + 0.4


def test_a_still_view_beside_a_moving_one_is_found_by_strong_priors(scene, still):
    for frozen in (0, 1):
        truth = np.stack([still[v] if v == frozen else scene.truth[v] for v in (0, 1)])
        y = pnp_sci.simulate(truth, scene.masks)
        found = solve(y, scene.masks, "flow")
        full, moving = (solve(y, scene.masks, "flow", scene="full", still=still) for still in (True, False))
        assert found.scene["still"] == (frozen == 0, frozen == 1)
        assert f"shows of view {frozen + 1}" in found.scene["reason"]
        assert psnr(found, truth) > psnr(moving, truth) + 0.3
        assert psnr(full, truth) > psnr(moving, truth), "pixel by pixel some of it is found as well"
        assert full.scene["at_rest"][frozen] > 1.5 * full.scene["at_rest"][1 - frozen]
        assert isinstance(solve(y, scene.masks, "tv", iterations=1).scene["still"], bool), "tv looks for none"


@pytest.mark.parametrize(("brightness", "seed"), [((1, 0.1), 0), ((1, 0.1), 1), ((0.1, 1), 2)])
def test_dim_views_are_not_frozen_beside_bright_ones(scene, brightness, seed):
    """As the errors of the bright view hide whether they move."""
    truth = scene.truth * np.array(brightness, np.float32)[:, None, None, None]
    masks = pnp_sci.random_masks(truth.shape, seed=seed)
    assert solve(pnp_sci.simulate(truth, masks), masks, "flow", iterations=1).scene["still"] is False


@pytest.mark.parametrize("prior", ["tv", "flow"])
@pytest.mark.parametrize("brightness", [(1, 0.5), (1, 0.1), (0.1, 1), (1, 0.05)])
def test_dim_views_that_move_are_neither_frozen_nor_left_out(scene, prior, brightness):
    truth = scene.truth * np.array(brightness, np.float32)[:, None, None, None]
    y = pnp_sci.simulate(truth, scene.masks)
    model = solve(y, scene.masks, prior, iterations=1).scene
    assert model["frames_modelled"] == model["frames"], model["reason"]


def test_flow_agrees_where_nothing_moves(scene, still):
    assert solve(pnp_sci.simulate(still, scene.masks), scene.masks, "flow", iterations=1).scene["still"]


def test_several_measurements_are_judged_apart(scene, still):
    y = np.stack([scene.y, pnp_sci.simulate(still, scene.masks)])
    judged = solve(y, scene.masks, iterations=2).scenes
    assert [s["still"] for s in judged] == [False, True]


@pytest.mark.parametrize("value", [0.0, 1.0])
def test_empty_scenes_have_a_model(scene, value):
    assert np.isfinite(solve(np.full_like(scene.y, value), scene.masks).x).all()


def test_a_view_that_is_not_dropped_stays_in_the_still_model(monkeypatch, scene):
    """A dim second view passes for dark by its level; if y says otherwise it must not vanish by the back door."""
    truth = scene.truth * np.array([1, 0.01], np.float32)[:, None, None, None]
    y = pnp_sci.simulate(truth, scene.masks)
    monkeypatch.setattr("pnp_sci.scene.judge._Comparison.__call__", lambda _, simple, *rest: simple.nothing_moves)
    assert solve(y, scene.masks, iterations=1).scene["views"] == (True, True)
