"""Advice from measured curves, with invented ones and with those of the package."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
from bench_rows import QUICK, SLOW, row

import pnp_sci
from pnp_sci import datasets
from pnp_sci.advice import recommend as budget
from pnp_sci.bench import Method, Results, read
from pnp_sci.errors import FormatError, InputError


@pytest.fixture
def results(tmp_path):
    kept = Results(tmp_path / "results.json")
    for measured in (QUICK, SLOW, replace(QUICK, method=Method(None, init="net"), course=QUICK.course[:1])):
        kept.add(measured)
    return kept.path


@pytest.mark.parametrize(
    ("seconds", "arguments"),
    [
        (0.15, {"model": "net"}),
        (0.3, {"prior": "quick", "iterations": 5}),
        (1.0, {"prior": "quick", "iterations": 10}),
        (99.0, {"prior": "slow", "iterations": 10}),  # and not 20, which are worse
    ],
)
def test_the_best_that_is_done_by_then(results, seconds, arguments):
    advice = pnp_sci.recommend(seconds, results=results)
    assert advice.arguments == arguments
    assert advice.seconds <= seconds
    assert advice.cases == ("car-b_car-w",)
    function = "decode" if "model" in arguments else "solve"
    assert advice.python.startswith(f"pnp_sci.{function}(y, masks, ")


def test_seconds_grow_with_the_size_and_with_the_machine(results):
    whole = pnp_sci.recommend(99, results=results)
    assert pnp_sci.recommend(99, (2, 10, 128, 256), results).seconds == pytest.approx(whole.seconds / 2)
    rows = json.loads(results.read_text())["rows"]
    for there in rows:
        there["machine"]["calibration"] *= 4  # of a machine four times as slow
    slower = results.with_name("slower.json")
    slower.write_text(json.dumps({"rows": rows}))
    assert pnp_sci.recommend(99, results=slower).seconds == pytest.approx(whole.seconds / 4)


@pytest.mark.parametrize(
    ("prior", "init", "start", "then"),
    [
        ("tv", "adjoint", 1, 1),
        ("tv+wavelet", "adjoint", 1, 1),
        ("tv", "ofanet-fast", 3, 1),
        ("video", "adjoint", 1, 3),
        ("tv+video", "adjoint", 1, 3),
        ("video", "ofanet-fast", 3, 3),
        (None, "ofanet-fast", 3, 1),
    ],
)
def test_networks_have_a_speed_of_their_own(tmp_path, monkeypatch, prior, init, start, then):
    """Here networks are three times as slow as where the row was measured, and all else is as quick."""
    pytest.importorskip("torch")
    machine = {"calibration": budget.calibrate(), "networks": 1.0}
    monkeypatch.setattr(budget, "calibrate_networks", lambda: 3.0)
    measured = row(method=Method(prior, init=init), machine=machine, settings={"init": init})
    if prior is None:
        measured = replace(measured, course=measured.course[:1])
    kept = Results(tmp_path / "results.json")
    kept.add(measured)
    first, last = (measured.course[k].seconds for k in (0, -1))
    advice = pnp_sci.recommend(99, results=kept.path)
    assert advice.seconds == pytest.approx(start * first + then * (last - first))


def test_what_a_process_must_load_first_counts_if_asked_for(results, monkeypatch):
    monkeypatch.delitem(sys.modules, "torch", raising=False)
    free = pnp_sci.recommend(99, results=results)
    assert pnp_sci.recommend(99, results=results, loading=True).seconds == pytest.approx(free.seconds + SLOW.loading)


def test_bad_input_is_named(results, tmp_path):
    with pytest.raises(InputError, match="budget_seconds is 0"):
        pnp_sci.recommend(0, results=results)
    with pytest.raises(InputError, match=r"budget_seconds is 0\.01: the quickest method needs 0\.1"):
        pnp_sci.recommend(0.01, results=results)
    with pytest.raises(InputError, match="like is 'nowhere'"):
        pnp_sci.recommend(1, "nowhere", results)
    with pytest.raises(InputError, match="singleview"):
        pnp_sci.recommend(1, "singleview", results)
    for like in (None, 3, (), (2, 10), (2, 10, -4, 64), (2, 10, 0, 64), (2, 10, 64.5, 64)):
        with pytest.raises(InputError, match="like is"):
            pnp_sci.recommend(5, like)
    assert pnp_sci.recommend(np.int64(5)) == pnp_sci.recommend(5)
    (tmp_path / "table.json").write_text('{"rows": [{"method": "tv"}]}')
    with pytest.raises(FormatError, match=r"table\.json.*'case'"):
        pnp_sci.recommend(1, results=tmp_path / "table.json")
    with pytest.raises(FileNotFoundError, match=r"nowhere\.json: there is no such file"):
        pnp_sci.recommend(1, results=tmp_path / "nowhere.json")
    np.savez(tmp_path / "binary.json.npz", np.arange(1000))
    with pytest.raises(FormatError, match=r"binary.*holds no results.*UnicodeDecodeError") as error:
        pnp_sci.recommend(1, results=tmp_path / "binary.json.npz")
    assert len(str(error.value)) < 300 + len(str(tmp_path))
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(FormatError, match=r"other\.json"):
        pnp_sci.recommend(1, results=tmp_path / "other.json")


def test_the_measurements_of_the_package(monkeypatch):
    rows = read(budget.MEASURED)
    monkeypatch.setattr(budget, "calibrate", lambda: rows[0].machine["calibration"])  # as quick a machine as theirs
    assert {row.shape[0] for row in rows} == {1, 2}
    little, much = (pnp_sci.recommend(seconds, like) for seconds, like in ((0.5, "dualview"), (1e4, "dualview")))
    assert little.psnr < much.psnr - 1
    single = pnp_sci.recommend(1e4, "singleview")
    assert set(single.cases) <= {"runner", "traffic", "kobe", "drop"}


def test_networks_are_loaded_only_if_that_takes_little_of_the_budget(monkeypatch, tmp_path):
    pytest.importorskip("torch")
    rows = json.loads(budget.MEASURED.read_text())["rows"]
    for there in rows:
        there["machine"] |= {"calibration": 0.01, "networks": 0.01}
    monkeypatch.setattr(budget, "MEASURED", tmp_path / "measured.json")
    budget.MEASURED.write_text(json.dumps({"rows": rows}))
    monkeypatch.setattr(budget, "calibrate", lambda: 0.01)
    monkeypatch.delitem(sys.modules, "torch", raising=False)

    def load() -> float:
        raise ImportError("networks are timed")

    monkeypatch.setattr(budget, "calibrate_networks", load)
    loading = budget._wait(rows)
    assert budget.prior_within(2 * loading, (2, 10, 64, 64)) == "flow"
    with pytest.raises(ImportError, match="timed"):
        budget.prior_within(9 * loading, (2, 10, 64, 64))


def test_auto_with_a_time_budget_takes_the_prior_that_shows_most_by_then(monkeypatch):
    calibration = read(budget.MEASURED)[0].machine["calibration"]
    monkeypatch.setattr(budget, "calibrate", lambda: calibration)
    shape = (2, 10, 256, 256)
    assert budget.prior_within(1e-9, shape) == "tv"
    assert budget.prior_within(0.3, shape) == "tv"
    monkeypatch.setattr(budget, "find_spec", lambda name: None)
    assert budget.prior_within(1e4, shape) == "flow"
    assert pnp_sci.recommend(1e4).arguments["prior"] == "flow"
    assert pnp_sci.recommend(1).arguments.get("init", "adjoint") == "adjoint"
    scene = datasets.embedded_scene(32)
    result = pnp_sci.solve(scene.y, scene.masks, "auto", time_budget=1e4, iterations=2)
    assert result.settings["prior"] == "flow"


def test_a_learned_prior_is_taken_where_the_budget_is_large():
    pytest.importorskip("torch")
    for size in ((2, 10, 256, 256), (1, 8, 256, 256)):
        assert budget.prior_within(1e4, size) == "video"
    assert pnp_sci.recommend(1e4).arguments.keys() <= {"prior", "init", "iterations"}
