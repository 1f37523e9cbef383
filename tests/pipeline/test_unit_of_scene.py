"""The unit of a scene whose brightest parts are small."""

import numpy as np
import pytest

import pnp_sci
from pnp_sci.pipeline.unit import in_unit_of_scene
from pnp_sci.plugins import registry
from pnp_sci.scene import choose
from pnp_sci.sensing.problem import check_operator, pose
from pnp_sci.sensing.sensor import Sensor


def particles(frames=8, side=48):
    """Three points of light that move in the dark, (1, B, H, W)."""
    rows, columns = np.mgrid[:side, :side]
    video = np.zeros((1, frames, side, side), np.float32)
    for place, speed in (((10, 10), (1, 2)), ((30, 40), (0.5, -2)), ((40, 8), (-2, 1.5))):
        for b in range(frames):
            i, j = np.array(place) + b * np.array(speed)
            video[0, b] += np.exp(-((rows - i) ** 2 + (columns - j) ** 2) / 8)
    return video.clip(0, 1)


def posed(truth, seed=0, noise=0.0):
    masks = pnp_sci.random_masks(truth.shape, seed=seed)
    y = pnp_sci.simulate(truth, masks, noise, seed=seed)
    op, largest = check_operator(masks, y[None])
    return pose(op, largest, y, Sensor())


def test_small_bright_parts_get_a_larger_unit():
    truth = particles()
    problem = posed(truth)
    [found] = in_unit_of_scene([problem])
    brightest = float(np.quantile(truth, 0.999))
    assert problem.unit < 0.5 * brightest
    assert 1.3 * problem.unit < found.unit < 1.3 * brightest


@pytest.mark.parametrize("noise", [0.0, 0.2])
def test_usual_scenes_keep_their_unit(noise):
    problem = posed(pnp_sci.datasets.embedded_scene(64).truth, noise=noise)
    [found] = in_unit_of_scene([problem])
    assert problem.unit <= found.unit < 1.2 * problem.unit


def test_the_problem_stays_the_same():
    problem = posed(particles(), noise=0.01)
    [found] = in_unit_of_scene([problem])
    np.testing.assert_allclose(found.y * found.unit, problem.y * problem.unit, rtol=1e-6)
    assert found.noise * found.unit == pytest.approx(problem.noise * problem.unit)


def test_consecutive_measurements_keep_a_common_unit():
    problems = [posed(particles(), seed) for seed in range(3)]
    problems = [problem.scaled(problems[0].unit / problem.unit) for problem in problems]
    units = [problem.unit for problem in in_unit_of_scene(problems)]
    assert units == pytest.approx([units[0]] * 3)
    assert units[0] > 1.3 * problems[0].unit


def test_nothing_is_changed_without_time_or_total_variation(monkeypatch):
    problem = posed(particles())
    assert in_unit_of_scene([problem], until=0) == [problem]
    monkeypatch.setattr(registry, "installed", lambda kind, name: None)
    assert in_unit_of_scene([problem]) == [problem]


def test_solves_and_decoders_take_it():
    truth = particles()
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    y = pnp_sci.simulate(truth, masks)
    plain, strong = (pnp_sci.solve(y, masks, prior, iterations=62) for prior in ("tv", "flow"))
    assert strong.settings["unit"][0] > 1.3 * plain.settings["unit"][0]
    decoder = pnp_sci.decode(y, masks, model=lambda problem, scene: np.zeros(problem.op.shape, np.float32))
    assert decoder.settings["unit"] == pytest.approx(strong.settings["unit"])


def test_hot_pixels_that_are_not_known_leave_the_unit():
    scene = pnp_sci.datasets.embedded_scene(64)
    op, largest = check_operator(scene.masks, scene.y[None])
    y = np.where(np.random.default_rng(0).random(scene.y.shape) < 0.01, 2 * scene.y.max(), scene.y)
    problem = pose(op, largest, y, Sensor())
    assert in_unit_of_scene([problem]) == [problem]


@pytest.mark.parametrize("sequence", [False, True])
def test_the_scene_is_judged_in_the_unit_that_y_alone_shows(monkeypatch, sequence):
    """Bug: in a larger unit fine texture that moves was taken for still."""
    judged = []

    def noted(problem, *given, **options):
        judged.append(problem.unit)
        return pnp_sci.SceneModel((True,), False)

    monkeypatch.setattr(choose, "judge", noted)
    truth = particles()
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    y = np.stack([pnp_sci.simulate(truth, masks)] * 3)
    plain, strong = (pnp_sci.solve(y, masks, p, iterations=3, sequence=sequence) for p in ("tv", "flow"))
    assert judged == pytest.approx([judged[0]] * len(judged))
    assert len(judged) == (2 if sequence else 6)
    assert plain.settings["unit"][0] == pytest.approx(judged[0])
    assert strong.settings["unit"][0] > 1.3 * judged[0]
