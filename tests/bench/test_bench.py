"""The bench: cases and methods, rows of processes of their own, files gone on with, curves, the paper's tables."""

import csv
import json
from dataclasses import asdict, replace

import numpy as np
import pytest
from bench_rows import QUICK, SLOW, row

import pnp_sci
from pnp_sci import bench, datasets, io
from pnp_sci.bench import Case, Method, Results, Row, paper
from pnp_sci.bench.runner import measure, scores
from pnp_sci.datasets import DUAL_VIEW_PAIRS
from pnp_sci.errors import FormatError, InputError, SolverError
from pnp_sci.metrics import psnr

# ---- cases and methods -----------------------------------------------------------------------------------------------


def test_groups_expand_in_order_and_once():
    assert bench.expand(["dualview", "embedded", "bear_blackswan"]) == [*map(Case, DUAL_VIEW_PAIRS), Case("embedded")]
    names = [case.name for case in bench.expand(["kobe"], [None, 0.1], [None, 6])]
    assert names == ["kobe", "kobe, 6 frames", "kobe, noise 0.1", "kobe, noise 0.1, 6 frames"]


def test_an_unknown_case_is_named_with_those_there_are():
    with pytest.raises(InputError, match=r"case is 'bears': a file, or one of these .* embedded, .*dualview"):
        bench.expand(["embedded", "bears"])
    with pytest.raises(InputError, match="case is 'real'"):
        Case("real").load()


def test_a_file_is_a_case(tmp_path):
    scene = datasets.embedded_scene(16)
    path = str(tmp_path / "meas.npz")
    io.write(path, {"y": scene.y, "masks": scene.masks, "x": scene.truth})
    (case,) = bench.expand([path])
    np.testing.assert_array_equal(case.load().truth, scene.truth)
    noisy = replace(case, noise=0.1, frames=4).load()
    assert noisy.masks.shape == noisy.truth.shape == (2, 4, 16, 16)
    np.testing.assert_allclose(noisy.y, pnp_sci.simulate(scene.truth[:, :4], scene.masks[:, :4], noise=0.1))
    io.write(path, {"y": scene.y, "masks": scene.masks})
    assert case.load().truth is None
    with pytest.raises(InputError, match=r"noise 0\.1.*truth is known"):
        replace(case, noise=0.1).load()
    with pytest.raises(InputError, match="frames is 11"):
        Case("embedded", frames=11).load()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_a_truth_in_grey_levels_is_scored_as_one_of_floats(tmp_path, kind):
    scene, white = datasets.embedded_scene(32), np.iinfo(kind).max
    levels = np.round(white * scene.truth).astype(kind)
    rows = []
    for truth in (levels, levels / white):
        path = str(tmp_path / f"{truth.dtype}.npz")
        io.write(path, {"y": pnp_sci.simulate(truth, scene.masks), "masks": scene.masks, "x": truth})
        rows.append(measure(Case(path), Method("tv", iterations=10)))
    assert rows[0].psnr == pytest.approx(rows[1].psnr, abs=1e-3)


def test_a_network_alone_is_a_method():
    alone, tv = bench.grid(["tv"], decoders=["ofanet-fast"])
    assert (alone.name, tv.name) == ("ofanet-fast alone", "tv")
    assert alone.python(None) == "result = pnp_sci.decode(y, masks, model='ofanet-fast')"
    pytest.importorskip("torch")
    scene = datasets.embedded_scene(32)
    expected = pnp_sci.decode(scene.y, scene.masks, model="ofanet-fast")
    np.testing.assert_array_equal(alone.run(scene.y, scene.masks).x, expected.x)


# ---- rows ------------------------------------------------------------------------------------------------------------


def test_scores_are_by_view_and_mean_over_measurements():
    rng = np.random.default_rng(0)
    truth, x = rng.random((2, 3, 2, 4, 16, 16))
    by_view, _ = scores(x, truth)
    assert by_view == pytest.approx(np.mean([psnr(a, b) for a, b in zip(x, truth)], axis=0))
    assert scores(x, None) == ((), ())


def test_a_row_is_measured_in_a_process_of_its_own():
    ballast = np.ones(2**26)  # 512 MiB that must not be counted
    case, method = Case("embedded"), Method("tv", iterations=12)
    row = bench.run(case, method, repeat=2)
    assert ballast.all()
    assert (row.case, row.method, row.iterations, row.status) == (case, method, 12, "iterations")
    assert len(row.seconds) == 2
    assert row.peak_mib is None or 20 < row.peak_mib < 500
    assert row.psnr == pytest.approx(measure(case, method).psnr, abs=0.01)
    assert [point.iteration for point in row.course] == [*range(11), 12]
    clock = [point.seconds for point in row.course]
    assert clock == sorted(clock)
    assert clock[-1] == pytest.approx(min(row.seconds))  # the median of two is the lower
    assert row.course[-1].psnr == pytest.approx(np.mean(row.psnr), abs=0.01)
    assert Row.from_dict(json.loads(json.dumps(asdict(row)))) == row


def test_a_course_is_a_mean_over_measurements_with_different_lengths(tmp_path):
    scene = datasets.embedded_scene(32)
    y = np.stack([scene.y, np.full_like(scene.y, scene.y.mean())])
    path = str(tmp_path / "two.npz")
    io.write(path, {"y": y, "masks": scene.masks})
    row = measure(Case(path), Method("tv", iterations=30))
    assert row.psnr == () and {point.psnr for point in row.course} == {None}  # noqa: PT018
    assert row.course[-1].iteration == 30
    assert 0 <= row.course[0].seconds < row.course[-1].seconds


def test_a_failing_row_says_why():
    with pytest.raises(SolverError, match=r"embedded with vt: .*'vt'"):
        bench.run(Case("embedded"), Method("vt"))


# ---- files -----------------------------------------------------------------------------------------------------------


def test_results_are_kept_and_found_again(tmp_path):
    path = tmp_path / "results.json"
    results = Results(path)
    results.add(row())
    results.add(row(method=Method("flow")))
    results.add(row(iterations=11))  # measured again
    again = Results(path)
    assert again.rows == results.rows
    assert len(again.rows) == 2
    assert again.find(Case("car-b_car-w"), Method("tv")) == row(iterations=11)
    assert again.find(Case("car-b_car-w", noise=0.1), Method("tv")) is None
    table = list(csv.DictReader((tmp_path / "results.csv").open()))
    assert [(line["prior"], line["iteration"], line["psnr"], line["ssim"]) for line in table[:3]] == [
        ("flow", "0", "15.0", ""),
        ("flow", "5", "20.0", ""),
        ("flow", "10", "22.0", "0.6"),
    ]
    assert sorted(p.name for p in tmp_path.glob("[!.]*")) == ["results.csv", "results.json"]


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"rows": [{}]}', '{"rows": 3}'])
def test_another_file_is_no_results(tmp_path, text):
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(FormatError, match=r"other\.json holds no results"):
        Results(path)


# ---- curves ----------------------------------------------------------------------------------------------------------


def test_curves_are_means_over_cases_and_the_front_is_what_none_beats(tmp_path):
    other = row(scene="hike_hockey", method=Method("quick"), course=((0, 0.3, 17.0), (5, 0.4, 20.0)))
    curves = bench.curves([QUICK, other, row(method=Method("partial"))])
    (moments,) = curves.values()  # the other method lacks a case
    assert [(m.iteration, m.psnr) for m in moments] == [(0, 16.0), (5, 20.0), (10, 21.0)]
    assert [m.seconds for m in moments] == pytest.approx([0.2, 0.3, 0.4])
    curves = bench.curves([QUICK, SLOW])
    best = [(moment.psnr, method.name) for moment, method in bench.front(curves)]
    assert best == [(15.0, "quick"), (20.0, "quick"), (22.0, "quick"), (25.0, "slow")]
    table = bench.front_table(curves, (0.05, 0.3, 30))
    assert table.splitlines()[2:] == ["| 0.3 s | 20.00 | quick | 5 |", "| 30 s | 25.00 | slow | 10 |"]
    bench.draw(tmp_path / "curves.svg", curves)
    assert "quick" in (tmp_path / "curves.svg").read_text() or (tmp_path / "curves.svg").stat().st_size > 5000
    with pytest.raises(InputError, match="no method"):
        bench.curves([replace(QUICK, psnr=())])


# ---- the paper's tables ----------------------------------------------------------------------------------------------


def test_the_papers_tables_have_ours_beside_them(tmp_path):
    rows = [row(scene=pair, method=method) for pair in ("car-b_car-w", "hike_hockey") for method in paper.OURS]
    rows += [replace(r, case=replace(r.case, noise=0.1), psnr=(11.0, 13.0)) for r in rows]
    files = paper.write(tmp_path / "results", rows)
    pages = {file.stem: file.read_text().splitlines() for file in files}
    assert set(pages) == {"dual-view", "frames", "noise", "single-view", "ablation", "warm-start"}
    lines = [line.strip("| ").split(" | ") for line in pages["dual-view"] if "|" in line]
    cells = {line[0]: line for line in lines}
    assert cells["car-b"][1] == "20.75 / 0.61"  # as published
    assert cells["car-b"][8:] == ["21.00 / 0.50"] * len(paper.OURS)
    assert cells["bear"][8:] == ["-"] * len(paper.OURS)  # never invented
    assert cells["average of car-b, car-w, hike, hockey"][1] == "21.68 / 0.61"
    assert cells["average of car-b, car-w, hike, hockey"][-1] == "22.00 / 0.60"
    (noise,) = (line for line in pages["noise"] if line.startswith("| 0.1 |"))
    assert noise.endswith("| 12.00 / 0.60 | 12.00 / 0.60 |")
    assert all(line.endswith(" - |") for line in pages["single-view"] if line.startswith("| kobe"))


def test_warm_starts_are_timed_against_the_end_of_the_cold_start(tmp_path):
    cold, warm, never = Method("tv", init="adjoint"), Method("tv", init="ofanet-fast"), Method("flow", "ofanet-fast")
    rows = [row(method=cold), row(method=replace(never, init="adjoint"))]
    rows += [row(method=warm, course=((0, 0.1, 19.0), (5, 0.3, 21.97), (10, 0.4, 22.5)), psnr=(22.0, 23.0))]
    rows += [row(method=never, course=((0, 0.1, 19.0), (5, 0.3, 21.0)), psnr=(21.0, 21.0))]
    (page,) = (file for file in paper.write(tmp_path, rows) if file.stem == "warm-start")
    lines = {line.split(" | ")[0]: line.strip("| ").split(" | ")[1:] for line in page.read_text().splitlines()}
    assert lines["| `tv` from `adjoint`"] == ["20.00", "22.00", "22.00", "22.00", "22.00", "0.4 s", "0.4 s"]
    assert lines["| `tv` from `ofanet-fast`"] == ["21.97", "22.50", "22.50", "22.50", "22.50", "0.4 s", "0.3 s"]
    assert lines["| `flow` from `ofanet-fast`"][-1] == "never"
    assert lines["| `video` from `adjoint`"] == ["-"] * 7


def test_the_plan_leaves_out_what_is_not_at_hand(monkeypatch, tmp_path):
    monkeypatch.setattr(paper, "_is_at_hand", {"kobe", "car-b_car-w"}.__contains__)
    assert {case.scene for case, _ in paper.plan()} == {"kobe", "car-b_car-w"}
