"""A mover is never erased: the residual of a still model is chance where nothing moves, and nowhere else."""

import importlib.util
import tracemalloc
from pathlib import Path

import numpy as np
import pytest

import pnp_sci
from pnp_sci import SceneModel, SensingOperator, solve
from pnp_sci.scene import movers
from pnp_sci.scene.movers import Tracks, limit, shows_more
from pnp_sci.scene.tracks import track_variance
from pnp_sci.scene.unused import Free, free_masks
from pnp_sci.sensing.scene_model import full

_spec = importlib.util.spec_from_file_location(
    "small_movers", Path(__file__).parents[2] / "benchmarks" / "small_movers.py"
)
cases = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(cases)
SIDE, FRAMES = cases.SIDE, cases.FRAMES


def measured(truth, masks, noise=0.01):
    return pnp_sci.simulate(truth.astype(np.float32), masks, noise=noise)


def still(y, masks, prior="tv"):
    return solve(y, masks, prior, iterations=1).scene["still"]


def standing(name, frames=FRAMES):
    return np.repeat(cases.background(name)[None], frames, axis=0)


@pytest.mark.parametrize("prior", ["tv", "flow"])
@pytest.mark.parametrize(("diameter", "level", "speed"), [(8, 1.0, 2), (13, 1.0, 2), (8, 0.0, 5), (20, 0.0, 1)])
@pytest.mark.parametrize("name", ["camera", "coins"])
def test_a_disc_that_crosses_a_standing_scene_is_modelled(name, diameter, level, speed, prior):
    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=3)
    assert still(measured(standing(name)[None], masks), masks, prior) is True
    truth = cases.crossing(cases.background(name), diameter, speed, level)
    assert still(measured(truth[None], masks), masks, prior) is False


def test_the_disc_is_seen():
    """Bug: a disc of 13 pixels before a standing scene was one picture."""
    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=3)
    truth = cases.crossing(cases.background("camera"), 13, 2, 1.0)
    result = solve(measured(truth[None], masks, noise=0), masks, "flow", iterations=80)
    assert cases.motion_seen(result.x[0], truth) > 0.8
    assert result.remarks == []


def test_a_reason_is_in_every_text_of_a_result():
    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=3)
    result = solve(measured(standing("camera")[None], masks), masks, iterations=2)
    for text in (repr(result), str(result), result._repr_html_()):
        assert "scene: nothing moves: one frame per view explains y" in text


def test_the_reason_is_in_a_comparison():
    from pnp_sci.bench import compare, grid
    from pnp_sci.bench.report import render
    from pnp_sci.cli.compare import _line

    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=3)
    found = compare(measured(standing("camera")[None], masks), masks, grid(["tv"], iterations=1))
    reason = "scene: nothing moves: one frame per view explains y"
    assert found.trials[0].row()["remarks"] == [reason]
    assert reason in _line(found.trials[0])
    assert reason in render(found, "still")


@pytest.mark.parametrize("frames", [6, 10, 20])
def test_any_number_of_frames(frames):
    masks = pnp_sci.random_masks((1, frames, SIDE, SIDE), seed=1)
    truth = cases.crossing(cases.background("camera"), 13, 2, 1.0, frames=frames)
    assert still(measured(truth[None], masks), masks) is False


OTHERS = {
    "fast": lambda back: cases.crossing(back, 10, 12, 1.0, start=0.05),
    "dim": lambda back: cases.crossing(back, 20, 2, float(back[SIDE // 2, 30:80].mean()) + 0.15),
    "in one frame": lambda back: _only(cases.crossing(back, 13, 2, 1.0), back, [3]),
    "appears": lambda back: _only(cases.crossing(back, 10, 0, 1.0), back, [4, 5, 6, 7]),
    "two": lambda back: _two(back),
}


def _only(video, back, frames):
    return np.stack([frame if b in frames else back for b, frame in enumerate(video)])


def _two(back):
    right, left = cases.crossing(back, 9, 2, 1.0), cases.crossing(back, 9, -3, 0.0, start=0.7)
    return np.where(np.roll(left, 30, 1) == 0, 0, right)


@pytest.mark.parametrize("kind", OTHERS)
def test_movers_of_other_kinds(kind):
    masks = pnp_sci.random_masks((1, FRAMES, SIDE, SIDE), seed=1)
    assert still(measured(OTHERS[kind](cases.background("camera"))[None], masks), masks) is False


@pytest.mark.parametrize("view", [0, 1])
def test_a_mover_in_one_view_of_two(view):
    views = [standing("camera"), standing("moon")]
    masks = pnp_sci.random_masks((2, FRAMES, SIDE, SIDE), seed=1)
    assert still(measured(np.stack(views), masks), masks) is True
    views[view] = cases.crossing(views[view][0], 13, 3, 1.0)
    found = still(measured(np.stack(views), masks), masks, "flow")
    assert found is not True
    assert found is False or not found[view], "the other view may be told to stand still"


def test_a_mover_in_a_dark_view_is_modelled():
    """A view whose level is near 0 may hold something small."""
    masks = pnp_sci.random_masks((2, FRAMES, SIDE, SIDE), seed=1)
    dark = np.zeros((FRAMES, SIDE, SIDE))
    spot = cases.crossing(dark[0], 13, 3, 1.0)
    moving = np.stack([np.roll(cases.background("camera"), 2 * b, 1) for b in range(FRAMES)])
    ys = [measured(np.stack([moving, second]), masks, 0) for second in (dark, spot)]
    views = [solve(y, masks, iterations=1).scene["views"] for y in ys]
    assert views == [(True, False), (True, True)]


@pytest.mark.parametrize("kind", ["independent", "cells", "moving", "sparse"])
def test_where_nothing_moves_scores_are_chance(kind):
    """For masks of any kind, whatever the residual's size from place to place."""
    rng = np.random.default_rng(0)
    shape = (1, FRAMES, 96, 96)
    masks = {
        "independent": lambda: rng.random(shape) < 0.5,
        "cells": lambda: np.kron(rng.random((1, FRAMES, 48, 48)) < 0.5, np.ones((1, 1, 2, 2), bool)),
        "moving": lambda: pnp_sci.moving_masks(shape),
        "sparse": lambda: rng.random(shape) < 0.2,
    }[kind]()
    op = SensingOperator(masks, np.float32)
    from scipy.ndimage import gaussian_filter

    for _ in range(4):
        loud = np.exp(20 * gaussian_filter(rng.standard_normal((96, 96)), 6))
        residual = (loud * gaussian_filter(rng.standard_normal((96, 96)), 0.7)).astype(np.float32)
        assert not shows_more(SceneModel((True,), True), op, residual)
        assert not shows_more(SceneModel((False,)), op, residual)


@pytest.mark.parametrize("model", [SceneModel((True,), True), SceneModel((False,))])
def test_what_follows_a_track_is_found_and_may_be_scaled(model):
    rng = np.random.default_rng(1)
    op = SensingOperator(rng.random((1, FRAMES, 96, 96)) < 0.5, np.float32)
    there = cases.crossing(np.zeros((96, 96)), 9, 3, 1.0)[None].astype(np.float32)
    there -= there.mean(1, keepdims=True)
    residual = op.forward(there) + 0.3 * rng.standard_normal((96, 96)).astype(np.float32)
    for scale in (1e-6, 1.0, -1e6):
        assert shows_more(model, op, np.float32(scale) * residual)
    assert not shows_more(full(op), op, residual), "all is modelled"


@pytest.mark.parametrize("shape", [(1, 1, 40, 40), (2, 4, 5, 60), (1, 2, 9, 9), (1, 3, 1, 1)])
def test_pictures_and_frames_of_any_number(shape):
    rng = np.random.default_rng(0)
    op = SensingOperator(rng.random(shape), np.float64)
    for residual in (np.zeros(shape[2:]), rng.standard_normal(shape[2:])):
        for model in (SceneModel((True,) * shape[0], True), SceneModel((False,) * shape[0])):
            assert not shows_more(model, op, residual)


@pytest.mark.parametrize("kind", ["independent", "moving"])
def test_scores_have_the_variance_of_many_draws_of_masks(kind):
    """The oracle: the sum along one track, for masks drawn 2000 times beside a fixed residual."""
    rng = np.random.default_rng(0)
    residual, frames, size = rng.standard_normal((24, 24)).astype(np.float32), 4, 24
    steps, sums = np.array([[0, 0], [1, 0], [2, 0]]), []
    for _ in range(2000):
        big = rng.choice([-1.0, 1.0], (size + frames, size + frames))
        if kind == "moving":
            masks = np.stack([big[b : b + size, b : b + size] for b in range(frames)])
        else:
            masks = rng.choice([-1.0, 1.0], (frames, size, size))
        masks = masks - masks.mean(0)
        sums.append(sum(float(np.sum((residual * masks[1 + k])[i : i + 8, 6:14])) for k, i in enumerate((5, 6, 7))))
    shift = np.array([-1, -1] if kind == "moving" else [0, 0])
    found = track_variance(residual, steps + np.array([5, 6]), 1, frames, 8, 1 / frames, shift)
    assert found == pytest.approx(np.var(sums), rel=0.15)


def test_a_pattern_that_moves_is_recognised():
    for step in ((1, -1), (-2, 0), (0, 3)):
        masks = pnp_sci.moving_masks((1, FRAMES, 64, 80), step=step)
        (free,) = free_masks(SceneModel((True,), True), SensingOperator(masks, np.float32))
        assert tuple(free.shift) == step
    (free,) = free_masks(SceneModel((True,), True), SensingOperator(pnp_sci.random_masks((1, 8, 64, 64)), np.float32))
    assert not free.shift.any()
    assert free.cell == pytest.approx(1, abs=0.3)
    cells = np.kron(pnp_sci.random_masks((1, 8, 32, 32)), np.ones((1, 1, 2, 2), bool))
    (free,) = free_masks(SceneModel((True,), True), SensingOperator(cells, np.float32))
    assert free.cell == pytest.approx(2, abs=0.4)


def test_tracks_cover_all_frames():
    for frames in (1, 2, 5, 8, 11, 30):
        tracks = Tracks.of(frames, True)
        for kind in (tracks.moving, ~tracks.moving):
            if kind.any():
                covered = {b for f, n in zip(tracks.first[kind], tracks.length[kind]) for b in range(f, f + n)}
                assert covered == set(range(frames))
        assert tracks.moving.any() == (frames > 1)
        assert (np.abs(tracks.speed[tracks.moving]) < movers.SIDE).all()


@pytest.mark.parametrize("share", [0, 0.1])
def test_the_variance_on_even_ground_counts_the_overlaps(share):
    tracks = Tracks.of(6, True)
    expected = []
    for speed, length in zip(tracks.speed, tracks.length):
        seen = np.zeros((length, 100, 100))
        for k, (row, column) in enumerate(50 + np.arange(length)[:, None] * speed):
            seen[k, row : row + movers.SIDE, column : column + movers.SIDE] = 1
        expected.append(movers.SIDE**2 / (np.sum(seen**2) - share * np.sum(seen.sum(0) ** 2)))
    np.testing.assert_allclose(movers._even(tracks.speed, tracks.length, share), expected)


def test_many_frames_need_little_memory():
    masks = pnp_sci.random_masks((1, 200, 32, 32), seed=0)
    y = masks[0].sum(0, dtype=np.float32)
    still = SceneModel((True,), True)
    shows_more(still, SensingOperator(masks, np.float32), y - y.mean())  # compiles
    tracemalloc.start()
    shows_more(still, SensingOperator(masks, np.float32), y - y.mean())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 20 * masks.size * 8


def test_the_limit_is_that_of_bonferroni():
    from scipy.stats import norm

    assert 2 * norm.sf(limit(1)) == pytest.approx(0.01)
    assert 2 * norm.sf(limit(1000, 2)) == pytest.approx(0.01 / 2000)
    assert isinstance(Free(np.zeros((2, 9, 9), np.float32), 0.5).shift, np.ndarray)
