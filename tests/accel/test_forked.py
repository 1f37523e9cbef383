"""Processes: forked after threads have been started, and without a place for compiled code."""

import os
import subprocess
import sys

import pytest

WORK = """
import multiprocessing, sys
import numpy as np
import pnp_sci

scene = pnp_sci.datasets.embedded_scene(256)

def work(prior):
    iterations = 62 if prior == "tv" else 2  # a few calls: strong priors have no warm-up after a decoder
    return pnp_sci.solve(scene.y, scene.masks, prior, iterations=iterations, scene="full").x

if __name__ == "__main__":
    here = work(sys.argv[1])
    with multiprocessing.get_context("fork").Pool(2) as pool:
        for there in pool.map_async(work, [sys.argv[1]] * 2).get(120):
            print(float(np.abs(there - here).max()))
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.parametrize("prior", ["tv", "flow", "video"])
def test_a_forked_child_solves_as_its_parent(prior, tmp_path):
    script = tmp_path / "work.py"
    script.write_text(WORK)
    done = subprocess.run([sys.executable, script, prior], capture_output=True, text=True, timeout=200)
    assert done.returncode == 0, done.stderr
    differences = [float(line) for line in done.stdout.split()]
    assert len(differences) == 2
    assert max(differences) < 0.02  # sums in another order


CODE = "import pnp_sci; s = pnp_sci.datasets.embedded_scene(32); print(pnp_sci.solve(s.y, s.masks, iterations=1))"


def test_a_full_disk_under_the_cache_is_said_and_survived(tmp_path):
    resource = pytest.importorskip("resource")
    full = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY)); " + CODE
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", full], capture_output=True, text=True, env=environment)
    assert resource
    assert done.returncode == 0, done.stderr
    assert "Result(" in done.stdout
    assert done.stderr.count("NUMBA_CACHE_DIR") == 1


def test_without_a_folder_for_the_cache_kernels_compile_all_the_same():
    """Numba finds no locator: neither beside the code, nor in a cache folder of the user."""
    without = "import numba.core.caching as c; c.CacheImpl._locator_classes = []; " + CODE
    done = subprocess.run([sys.executable, "-c", without], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "Result(" in done.stdout
    assert "NUMBA_CACHE_DIR" in done.stderr
