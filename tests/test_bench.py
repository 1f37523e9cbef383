import json

import numpy as np
import pytest

from pnp_sci import bench
from pnp_sci.bench.runner import measure, scores
from pnp_sci.datasets import DUAL_VIEW_PAIRS
from pnp_sci.errors import InputError, SolverError
from pnp_sci.metrics import psnr


def test_groups_expand_in_order_and_once():
    assert bench.expand(["dualview", "embedded", "bear_blackswan"]) == [*DUAL_VIEW_PAIRS, "embedded"]


def test_an_unknown_case_is_named_with_those_there_are():
    with pytest.raises(InputError, match=r"case is 'bears': one of embedded, .*dualview"):
        bench.expand(["embedded", "bears"])
    with pytest.raises(ValueError, match="values to unpack"):
        bench.load("real")


def test_scores_are_by_view_and_mean_over_measurements():
    rng = np.random.default_rng(0)
    truth, x = rng.random((2, 3, 2, 4, 16, 16))
    by_view, _ = scores(x, truth)
    assert by_view == pytest.approx(np.mean([psnr(a, b) for a, b in zip(x, truth)], axis=0))
    assert scores(x, None) == ((), ())


def test_a_row_is_measured_in_a_process_of_its_own():
    ballast = np.ones(2**26)  # 512 MiB that must not be counted
    row = bench.run("embedded", "tv", repeat=2, iterations=2)
    assert ballast.all()
    assert (row.case, row.prior, row.iterations, row.status) == ("embedded", "tv", 2, "iterations")
    assert len(row.seconds) == 2
    assert row.peak_mib is None or 20 < row.peak_mib < 500
    assert row.psnr == pytest.approx(measure("embedded", "tv", 1, 2).psnr, abs=0.01)
    (kept,) = json.loads(bench.as_json([row]))["rows"]
    assert kept["psnr"] == list(row.psnr)


def test_a_failing_row_says_why():
    with pytest.raises(SolverError, match=r"embedded with vt: .*'vt'"):
        bench.run("embedded", "vt")
