"""Several measurements with the same masks: each as if it were alone, and stopped all together."""

import itertools

import numpy as np
import pytest

import pnp_sci
from pnp_sci import Result, SceneModel, Status, datasets, solve
from pnp_sci.errors import InputTypeError
from pnp_sci.plugins import registry


@pytest.fixture(scope="module")
def scene():
    return datasets.embedded_scene(64)


@pytest.fixture(scope="module")
def three(scene):
    """Measurements of three scenes."""
    videos = scene.truth, scene.truth[:, ::-1], np.repeat(scene.truth[:, :1], scene.masks.shape[1], 1)
    return np.stack([pnp_sci.simulate(video, scene.masks) for video in videos])


def test_several_measurements(scene):
    other = pnp_sci.simulate(scene.truth[:, ::-1], scene.masks)
    both = solve(np.stack([scene.y, other]), scene.masks, iterations=10, reference=np.stack([scene.truth] * 2))
    alone = solve(other, scene.masks, iterations=10)
    assert both.x.shape == (2, *scene.masks.shape)
    np.testing.assert_array_equal(both.x[1], alone.x)
    assert [r.measurement for r in both.history] == [0] * 11 + [1] * 11


@pytest.mark.parametrize("options", [{}, {"scene": "full"}, {"scene": SceneModel((True, False))}])
def test_each_measurement_has_its_scene(scene, three, options):
    together = solve(three, scene.masks, iterations=1, **options)
    alone = [solve(y, scene.masks, iterations=1, **options) for y in three]
    assert together.scenes == [result.scene for result in alone]
    assert len(solve(three[:1], scene.masks, iterations=1, **options).scenes) == 1


def test_each_measurement_that_is_decoded_has_its_scene(scene, three, monkeypatch):
    monkeypatch.setitem(
        registry._registered["decoders"], "grey", lambda: lambda problem, scene: np.full(problem.op.shape, 0.5)
    )
    assert [len(pnp_sci.decode(y, scene.masks, "grey").scenes) for y in (three[0], three[:1], three)] == [1, 1, 3]


def test_a_warning_of_many_measurements_names_the_first_ones(scene, caplog):
    pnp_sci.decode(np.stack([scene.y] * 12), scene.masks[:, :, ::-1], lambda problem, model: np.zeros(problem.op.shape))
    (record,) = (record for record in caplog.records if "measurements" in record.message)
    assert record.message.startswith("measurements 1, 2, 3, 4, 5, 6, 7, 8, 9, 10 and 2 more: ")


@pytest.mark.parametrize("answer", [np.ones(3), np.ones((2, 2), bool)])
def test_a_callback_that_returns_an_array(scene, answer):
    with pytest.raises(InputTypeError, match="callback returns ndarray: None, True or False"):
        solve(scene.y, scene.masks, callback=lambda state: answer, iterations=2)


def test_callback_stops_and_sees_every_state(scene):
    seen = []
    result = solve(scene.y, scene.masks, callback=lambda s: seen.append(s.iteration) or s.iteration == 5)
    assert result.status is Status.STOPPED
    assert seen == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize(("at", "begun"), [(0, 1), (5, 1), (12, 2), (17, 3)])
def test_a_callback_that_stops_stops_all_measurements(scene, three, at, begun):
    """Those that have not begun are left as they begin: a record, a finite video, and the status that says so."""
    calls, seen = itertools.count(), []

    def callback(state):
        seen.append(state.iteration)
        return next(calls) == at

    truth = np.stack([scene.truth] * 3)
    result = solve(three, scene.masks, iterations=5, tol=0, callback=callback, reference=truth)
    assert len(seen) == at + 1, "it is not asked again"
    assert result.status is Status.STOPPED
    assert len(result.scenes) == 3
    assert np.isfinite(result.x).all()
    for n in range(3):
        records = [record for record in result.history if record.measurement == n]
        assert [record.iteration for record in records] == list(range(len(records)))
        assert len(records) == (min(6, at + 1 - 6 * n) if n < begun else 1)
        assert records[-1].psnr == pytest.approx(np.mean(pnp_sci.psnr(result.x[n], scene.truth)), abs=1e-3)
        missing = three[n] - pnp_sci.SensingOperator(scene.masks).forward(result.x[n])
        expected = np.linalg.norm(missing) / np.linalg.norm(three[n])
        assert records[-1].residual == pytest.approx(expected, rel=1e-3)
    full = solve(three, scene.masks, iterations=5, tol=0, reference=truth)
    for n in range(begun - 1):
        assert np.array_equal(result.x[n], full.x[n])
    assert "nan" not in str(result)


def test_what_a_callback_has_stopped_can_be_kept(scene, three, tmp_path):
    result = solve(three, scene.masks, iterations=3, callback=lambda state: True)
    result.save(tmp_path / "stopped.npz")
    back = Result.load(tmp_path / "stopped.npz")
    assert back.status is Status.STOPPED
    assert np.array_equal(back.x, result.x)
    assert len(back.scenes) == 3
    assert "iterations in" in str(back)


def test_the_status_of_many_is_the_worst(scene, three):
    """One that fails does not stop the others."""
    calls = itertools.count()

    def fails_once(x, sigma):
        return x * np.nan if next(calls) == 1 else x.copy()

    result = solve(three, scene.masks, fails_once, iterations=3, tol=0)
    assert result.status is Status.NOT_FINITE
    counts = [max(record.iteration for record in result.history if record.measurement == n) for n in range(3)]
    assert counts == [1, 3, 3]
    assert np.isfinite(result.x).all()
