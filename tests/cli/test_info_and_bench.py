"""The commands ``pnp-sci info``, ``priors``, ``bench`` and ``recommend``."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import fails, run

import pnp_sci
from pnp_sci import io
from pnp_sci.plugins import registry

pytest_plugins = "with_files"


def test_info_reports_on_arrays_masks_and_results(meas):
    done = run("info", meas)
    assert done.exit_code == 0
    assert "measurement: 32 x 32" in done.output
    assert "Masks: 2 views x 10 frames of 32 x 32, bool, binary" in done.output
    assert "the views can be told apart" in done.output
    run("solve", meas, "--iterations", 2, "--seed", 7)
    report = run("info", "result.npz").output
    assert "Result(2 views x 10 frames of 32 x 32, 2 iterations" in report
    assert json.loads(report[report.index("\n{") :])["seed"] == 7


def test_info_reports_on_stores(meas):
    zarr = pytest.importorskip("zarr")
    run("solve", meas, "--iterations", "2", "--out", "result.zarr")
    assert '"prior": "tv"' in run("info", "result.zarr").output
    pnp_sci.reconstruct(io.read(meas, "y"), io.read_masks(meas), "video.zarr", prior="tv", iterations=2)
    assert "Reconstruction(" in run("info", "video.zarr").output
    zarr.save_array("other.zarr", np.ones((4, 4)))
    for place in ("video.zarr", "result.zarr", "other.zarr"):
        assert "is a Zarr store" in fails(1, "solve", place)
    assert "is a Zarr store" in fails(1, "info", "other.zarr")


def test_priors_lists_what_is_installed_with_a_summary(monkeypatch):
    def own():
        """Leaves everything as it is."""

    monkeypatch.setitem(registry._registered["priors"], "own", own)
    done = run("priors")
    assert done.exit_code == 0
    assert re.search(r"^  own +Leaves everything as it is\.$", done.output, re.M)
    for name in registry.available("priors"):
        assert re.search(rf"^  {re.escape(name)} +\S", done.output, re.M), name


def test_bench_makes_a_table(here):
    done = run("bench", "--iterations", 2, "--repeat", 2, "--out", "b.json", "--markdown", "b.md", "--curves", "c.svg")
    assert done.exit_code == 0, done.output
    (row,) = json.loads(Path("b.json").read_text())["rows"]
    assert (row["case"]["scene"], row["method"]["prior"], row["iterations"]) == ("embedded", "tv", 2)
    assert len(row["psnr"]) == len(row["ssim"]) == len(row["seconds"]) == 2
    assert done.stdout.startswith(Path("b.md").read_text())
    assert "| embedded | tv, 2 iterations |" in done.stdout
    assert "| within | PSNR (dB) | method | iterations |" in done.stdout
    assert Path("c.svg").stat().st_size > 5000


def test_bench_goes_on_where_it_was(here, monkeypatch):
    row = ("bench", "--iterations", 2, "--out", "b.json")
    assert run(*row).exit_code == 0
    before = Path("b.json").read_text()
    monkeypatch.setattr("pnp_sci.bench.run", lambda *_: pytest.fail("measured again"))
    done = run(*row)
    assert done.exit_code == 0, done.output
    assert "| embedded | tv, 2 iterations |" in done.stdout
    assert Path("b.json").read_text() == before


def test_recommend(here):
    done = run("recommend", 1e4, "--like", "2x10x64x64")
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("pnp_sci.solve(y, masks, prior=")
    assert "budget_seconds is 1e-09" in fails(1, "recommend", "1e-9")


def test_bench_goes_on_after_a_failure(here, monkeypatch):
    monkeypatch.setenv("PNP_SCI_DATA", str(here / "empty"))
    done = run("bench", "--cases", "kobe,embedded", "--iterations", 1)
    assert done.exit_code == 1
    assert "| embedded | tv, 1 iteration |" in done.stdout
    assert "Error: kobe with tv, 1 iteration: " in done.stderr
    assert "PNP_SCI_DATA" in done.stderr
    assert "'nowhere'" in fails(1, "bench", "--cases", "nowhere")
