"""Time of the fused projection against numpy and a plain in-place pass; memory of solve() and its scaling with size.

python benchmarks/operator_speed.py
"""

import re
import statistics
import subprocess
import sys
import time
from pathlib import Path

import numba
import numpy as np

import pnp_sci

SHAPE = (2, 10, 1024, 1024)
REPEATS = 40


@numba.njit(parallel=True)
def in_place(x):
    """One parallel pass over x that reads and writes each value."""
    for block in numba.prange(x.size // 4096):
        for i in range(block * 4096, (block + 1) * 4096):
            x[i] = x[i] * np.float32(0.999) + np.float32(0.001)


def projection():
    rng = np.random.default_rng(0)
    masks = pnp_sci.random_masks(SHAPE).view(np.uint8)
    op = pnp_sci.SensingOperator(masks)
    x = rng.random(SHAPE, dtype=np.float32)
    y = op.forward(rng.random(SHAPE, dtype=np.float32))
    floats = masks.astype(np.float32)

    def formula():
        return x + floats * ((y - (floats * x).sum((0, 1))) / op.gram)

    jobs = {
        "fused": lambda: op.project(x, y, out=x),
        "in place": lambda: in_place(x.reshape(-1)),
        "numpy": formula,
    }
    seconds = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(REPEATS):
        for name in rng.permutation(list(jobs)):  # random order, as the state of the cache depends on the job before
            begin = time.perf_counter()
            jobs[name]()
            seconds[name].append(time.perf_counter() - begin)
    median = {name: statistics.median(s) for name, s in seconds.items()}
    for name, value in median.items():
        print(f"{name:9} {1000 * value:7.2f} ms ({1000 * min(seconds[name]):.2f} ... {1000 * max(seconds[name]):.2f})")
    speed, cost = median["numpy"] / median["fused"], median["fused"] / median["in place"]
    print(f"numpy / fused {speed:.1f}, fused / in place {cost:.2f}")


def memory():
    """Additional peak memory of solve(prior="tv"), in units of the video's size, measured in a child process."""
    child = subprocess.run([sys.executable, __file__, "--memory"], capture_output=True, text=True, check=True)
    print(child.stdout.strip())


def measure_memory():
    small = pnp_sci.datasets.embedded_scene(200)
    pnp_sci.solve(small.y, small.masks, iterations=45, tol=0)  # compile and load
    scene = pnp_sci.datasets.embedded_scene(SHAPE[-1])
    y, masks, size = scene.y, scene.masks, scene.truth.size
    del scene
    before = resident("VmRSS")
    Path("/proc/self/clear_refs").write_text("5")  # resets the peak
    pnp_sci.solve(y, masks, iterations=45, tol=0)
    peak = resident("VmHWM") - before
    print(f"peak memory of solve: {peak / (4 * size):.1f} times the video")


def resident(field):
    """Resident memory of this process in bytes, current (VmRSS) or peak (VmHWM); Linux."""
    return 1024 * int(re.search(rf"{field}:\s+(\d+)", Path("/proc/self/status").read_text())[1])


def growth():
    """Time per iteration and per pixel from 256 x 256 to 2048 x 2048."""
    for side in (256, 512, 1024, 2048):
        scene = pnp_sci.datasets.embedded_scene(side)
        pnp_sci.solve(scene.y, scene.masks, iterations=1)
        records = pnp_sci.solve(scene.y, scene.masks, iterations=12, tol=0, scene="full").history["seconds"]
        per_iteration = statistics.median(np.diff(records))
        per_pixel = 1e9 * per_iteration / side**2
        print(f"{side:5} x {side}: {1000 * per_iteration:8.2f} ms an iteration, {per_pixel:.1f} ns a pixel")


if __name__ == "__main__":
    if "--memory" in sys.argv:
        measure_memory()
    else:
        projection()
        memory()
        growth()
