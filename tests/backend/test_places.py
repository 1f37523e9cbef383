"""Which priors work on a device: what the guide says is what they do."""

import re
from pathlib import Path

import numpy as np
import pytest
from operators_and_priors import by_name

import pnp_sci
from pnp_sci.plugins.combine import begun
from pnp_sci.plugins.on_host import OnHost

pytest.importorskip("torch")
GUIDE = Path(__file__).parents[2] / "docs" / "guide" / "gpu.md"
ROW = re.compile(r"^\| `(\w+)` \| (.*) \|$", re.MULTILINE)


def stays_on_the_cpu(session):
    return isinstance(session, OnHost)


@pytest.mark.parametrize("name", map(by_name, ["tv", "wavelet", "bm3d", "flow", "desci", "ffdnet", "video"]))
def test_the_guide_says_where_a_prior_runs(name):
    rows = dict(ROW.findall(GUIDE.read_text(encoding="utf-8")))
    session = begun(pnp_sci.as_prior(name), (1, 3, 32, 32), np.dtype("f4"), "cpu")
    assert stays_on_the_cpu(session) == (rows[name] == "all of it")
