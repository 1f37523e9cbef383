"""Threads: held to a number while something is computed, and restored afterwards."""

import os
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
from threadpoolctl import threadpool_info

import pnp_sci
from pnp_sci import datasets
from pnp_sci.accel.threads import limited
from pnp_sci.errors import InputError
from priors.motion import measure as motion

pytestmark = pytest.mark.threads


def test_all_are_limited_and_restored_afterwards():
    before, pools = numba.get_num_threads(), threadpool_info()
    with limited(1):
        assert numba.get_num_threads() == 1
        assert {pool["num_threads"] for pool in threadpool_info()} <= {1}
    with limited(10_000):  # more than there are
        assert numba.get_num_threads() == before
    with pytest.raises(ZeroDivisionError), limited(1):
        _ = 1 / 0
    assert (numba.get_num_threads(), threadpool_info()) == (before, pools)


def test_those_that_overlap_put_back_what_there_was():
    """Whoever comes second must not take the limit of the first for what there was."""
    opencv = pytest.importorskip("cv2")
    scene = datasets.embedded_scene(64)
    pnp_sci.solve(scene.y, scene.masks, "flow", iterations=35)  # loads all libraries that there are to be
    before, pools = opencv.getNumThreads(), threadpool_info()
    first, second = threading.Event(), threading.Event()

    def early():
        own = [pool for pool in threadpool_info() if pool["user_api"] == "openmp"]  # limits of this thread
        with limited(1), motion._opencv.at_most(1):
            first.set()
            second.wait(60)
        result.append([pool for pool in threadpool_info() if pool["user_api"] == "openmp"] == own)

    def late():
        first.wait(60)
        with limited(1), motion._opencv.at_most(1):
            second.set()
            other.join()
            assert opencv.getNumThreads() == 1
        result.append(pnp_sci.solve(scene.y, scene.masks, "flow", iterations=35, threads=1).status.ok)

    result = []
    other, last = threading.Thread(target=early), threading.Thread(target=late)
    other.start(), last.start()
    last.join()
    assert result == [True, True]
    assert (opencv.getNumThreads(), threadpool_info()) == (before, pools)


def test_networks_and_flow_take_no_more_than_the_kernels():
    torch = pytest.importorskip("torch")
    seen = []

    class Look(torch.nn.Module):
        def forward(self, x, sigma):
            seen.append((torch.get_num_threads(), numba.get_num_threads()))
            return x

    before = torch.get_num_threads()
    scene = datasets.embedded_scene(32)
    one = pnp_sci.solve(scene.y, scene.masks, Look(), iterations=1, threads=1)
    assert seen == [(1, 1)]
    assert torch.get_num_threads() == before
    assert one.settings["threads"] == 1


@pytest.mark.parametrize(("prior", "options", "largest"), [("tv", {}, 1e-4), ("flow", {"first": 15}, 0.1)])
def test_the_result_does_not_depend_on_threads(prior, options, largest):
    """With flow each search of the motion grows rounding errors: to half a grey level of 8 bits in the mean."""
    scene = datasets.embedded_scene(64)
    results = (pnp_sci.solve(scene.y, scene.masks, prior, iterations=25, threads=n, **options) for n in (1, None))
    one, all_of_them = (result.x for result in results)
    np.testing.assert_allclose(one, all_of_them, atol=largest)
    assert np.abs(one - all_of_them).mean() < 1 / 510
    assert pnp_sci.psnr(one, scene.truth) == pytest.approx(pnp_sci.psnr(all_of_them, scene.truth), abs=0.03)


@pytest.mark.parametrize("threads", [0, -1, 1.5, "two"])
def test_bad_numbers_are_named(threads):
    scene = datasets.embedded_scene(16)
    with pytest.raises(InputError, match="threads is"):
        pnp_sci.solve(scene.y, scene.masks, threads=threads)


@pytest.mark.parametrize(
    ("given", "then"),
    [({}, "10000"), ({"GOMP_SPINCOUNT": "7"}, "7"), ({"OMP_WAIT_POLICY": "active"}, "None")],
)
def test_waiting_threads_sleep_soon(given, then):
    unset = {name: value for name, value in os.environ.items() if name not in ("GOMP_SPINCOUNT", "OMP_WAIT_POLICY")}
    code = "import os, pnp_sci.accel.jit; print(os.environ.get('GOMP_SPINCOUNT'))"
    done = subprocess.run([sys.executable, "-c", code], env=unset | given, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == then
