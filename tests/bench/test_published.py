import doctest

import numpy as np
import pytest

from pnp_sci import bench, datasets
from pnp_sci.bench import published
from pnp_sci.bench.published import ABLATION, AVERAGE, DUAL_VIEW, FRAMES, NOISE, SINGLE_VIEW
from pnp_sci.datasets import DUAL_VIEW_PAIRS

TABLES = (DUAL_VIEW, ABLATION, FRAMES, NOISE, SINGLE_VIEW)
# The paper's own slips: the mean of the column where the average printed is another.
NOT_THE_MEAN = {
    ("Table 2", "PnP-TV-FFD", "psnr"): 22.4508,  # printed: 22.54
    ("Table 6", "U-net", "psnr"): 29.5983,  # printed: 29.26
    ("Table 6", "GAP-TV", "ssim"): 0.8508,  # printed: 0.858
}


def videos(table):
    return [row for row in table.rows if row != AVERAGE]


# SSIM of two decimals: its mean is known to 0.005, and the average is rounded by as much again.
@pytest.mark.parametrize(("table", "tolerance"), [(DUAL_VIEW, 0.01), (ABLATION, 0.01), (SINGLE_VIEW, 0.002)])
def test_averages_are_means_of_their_columns(table, tolerance):
    for method in table.columns:
        for metric, allowed in (("psnr", 0.02), ("ssim", tolerance)):
            mean = np.mean([getattr(table.values[video][method], metric) for video in videos(table)])
            printed = getattr(table.values[AVERAGE][method], metric)
            slip = NOT_THE_MEAN.get((table.source, method, metric))
            assert mean == pytest.approx(printed if slip is None else slip, abs=allowed + 1e-9), (method, metric)
            assert slip is None or abs(mean - printed) > allowed, "not a slip"


def test_tables_agree_where_they_repeat_each_other():
    average = DUAL_VIEW.values[AVERAGE]
    for method in DUAL_VIEW.columns:
        assert NOISE.values[0][method] == (*average[method][:2], None)
    for method in set(DUAL_VIEW.columns) & set(FRAMES.columns) - {"ADMM-net"}:
        assert FRAMES.values[10][method] == average[method]
    assert FRAMES.values[10]["ADMM-net"][:2] == average["ADMM-net"][:2]  # the paper has two running times for it
    assert FRAMES.values[10]["DA&DNS"] == ABLATION.values[AVERAGE]["w/o RN"]
    assert all(ABLATION.values[row]["OFaNet"] == DUAL_VIEW.values[row]["OFaNet"] for row in DUAL_VIEW.rows)


def test_gains_are_those_of_the_text():
    """'The average gains of OFaNet over {...} are as much as {2.63, 2.58, 0.61, 2.15, 0.98, 1.19} dB on PSNR'."""
    *others, ofanet = (score.psnr for score in DUAL_VIEW.values[AVERAGE].values())
    assert ofanet - np.array(others) == pytest.approx([2.63, 2.58, 0.61, 2.15, 0.98, 1.19])


def test_names_are_those_of_our_cases():
    for table in (DUAL_VIEW, ABLATION):
        names = videos(table)
        assert {f"{first}_{second}" for first, second in zip(names[::2], names[1::2])} == set(DUAL_VIEW_PAIRS)
    shared = set(videos(SINGLE_VIEW)) - {"aerial", "vehicle"}
    assert shared == {*datasets.SINGLE_VIEW, "kobe"}
    for name in (*DUAL_VIEW_PAIRS, *shared):
        assert len(bench.expand([name])) == 1


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.source)
def test_cells_are_plausible(table):
    for row in table.rows:
        assert tuple(table.values[row]) == table.columns
        for score in table.values[row].values():
            assert 5 < score.psnr < 45
            assert 0 < score.ssim < 1
            assert score.seconds is None or score.seconds > 0


def test_examples():
    assert doctest.testmod(published).failed == 0
