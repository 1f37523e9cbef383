"""The recipe for SLURM in the guide, with a cluster of this process in its place."""

import re
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from small import capture

import pnp_sci
from pnp_sci import io

distributed = pytest.importorskip("distributed")
pytest.importorskip("zarr")
pytest.importorskip("h5py")
GUIDE = Path(__file__).parents[2] / "docs" / "guide" / "fleets.md"


def test_the_recipe_runs(tmp_path, monkeypatch):
    (recipe,) = re.findall(r"^```{code-block} python\n(from dask_jobqueue.*?)^```", GUIDE.read_text(), re.M | re.S)
    asked = {}

    class SLURMCluster(distributed.LocalCluster):
        def __init__(self, **options):
            asked.update(options)
            super().__init__(n_workers=0, threads_per_worker=1, processes=False, dashboard_address=":0")

        def scale(self, n=0, jobs=None):
            super().scale(n if jobs is None else 1)  # threads of a process can serve one worker

    monkeypatch.setitem(sys.modules, "dask_jobqueue", ModuleType("dask_jobqueue"))
    sys.modules["dask_jobqueue"].SLURMCluster = SLURMCluster
    monkeypatch.chdir(tmp_path)
    y, masks = capture(3)
    io.write("capture.h5", {"y": y})
    io.write("masks.mat", {"mask": masks})
    exec(recipe.replace('prior="flow"', 'prior="tv", iterations=3'), {"__name__": "__main__"})
    videos = pnp_sci.Reconstruction("videos.zarr")
    assert videos.ok
    assert asked["cores"] == asked["processes"]  # one thread for each
    np.testing.assert_array_equal(videos.video(2), pnp_sci.solve(y[2], masks, iterations=3).x)
