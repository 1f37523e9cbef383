"""``pnp_sci.reconstruct``: two workers against one, kills, memory by the number of measurements.

    python benchmarks/fleet.py [--count 200] [--size 128] [--repeat 3]

One worker and two alternate, each worker with one thread. Seconds are of the whole call, start of the workers included.
"""

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import pnp_sci

WORKERS = (1, 2)
FRAMES = 8


def capture(folder, count, size):
    """Files with measurements of the embedded scene, moved anew for each, with noise, and with their masks."""
    truth = pnp_sci.datasets.embedded_scene(size).truth[:1, :FRAMES]
    masks = pnp_sci.random_masks(truth.shape, seed=1)
    rng, y = np.random.default_rng(2), np.empty((count, size, size), np.float32)
    for n in range(count):
        moved = np.roll(truth, rng.integers(0, size, 2), (2, 3))
        y[n] = (masks * moved).sum((0, 1)) + 0.02 * rng.standard_normal((size, size))
    np.save(folder / "y.npy", y)
    np.save(folder / "masks.npy", masks.astype(np.float32))


def command(folder, out, workers):
    arguments = [folder / "y.npy", "--masks", folder / "masks.npy", "--out", out, "--workers", workers, "--threads", 1]
    return [sys.executable, "-m", "pnp_sci", "reconstruct", *map(str, arguments)]


def run(folder, out, workers):
    """Seconds of a run in processes of its own."""
    begin = time.perf_counter()
    subprocess.run(command(folder, out, workers), check=True, capture_output=True)
    return time.perf_counter() - begin


def videos(out):
    return {str(file.relative_to(out)): file.read_bytes() for file in (out / "0").rglob("*") if file.is_file()}


def children(process):
    """Ids of the workers of a command: descendants without descendants."""
    import psutil

    below = psutil.Process(process.pid).children(recursive=True)
    return [child.pid for child in below if "spawn_main" in " ".join(child.cmdline())]


def after_kills(folder, expected, count):
    """Videos that differ after a worker has been killed, then the client, and the command was given again."""
    out, killed = folder / "killed.zarr", []
    for whom in ("worker", "client"):
        process = subprocess.Popen(command(folder, out, 2), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        begun, records = done(out), 0
        while records < begun + count // 5 and process.poll() is None:
            time.sleep(0.05)
            records = done(out)
        os.kill(children(process)[0] if whom == "worker" else process.pid, signal.SIGKILL)
        killed.append(done(out))
        if whom == "worker":
            while done(out) < begun + 2 * count // 5 and process.poll() is None:
                time.sleep(0.05)
            process.kill()
        process.wait()
        time.sleep(1)
    run(folder, out, 2)
    found = videos(out)
    differ = sum(found.get(name) != content for name, content in expected.items())
    print(f"killed with {killed} of {count} done (a worker, then the client), then run again: "
          f"{len(found)} of {len(expected)} files are there, {differ} differ")  # fmt: skip


def done(out):
    return len(list((out / "records").glob("0*.json")))


def peak(folder, out, workers=2):
    """Largest memory of the client and of a worker, in bytes."""
    code = (
        "import sys, numpy as np, pnp_sci, distributed; from pnp_sci.accel.memory import peak_memory\n"
        "if __name__ == '__main__':\n"
        f"    cluster = distributed.LocalCluster(n_workers={workers}, threads_per_worker=1, memory_limit=0)\n"
        "    client = distributed.Client(cluster); folder, out = sys.argv[1:]\n"
        "    masks = np.load(folder + '/masks.npy')\n"
        "    pnp_sci.reconstruct(folder + '/y.npy', masks, out, client, threads=1)\n"
        "    print(peak_memory(), max(client.run(peak_memory).values()))\n"
    )
    script = folder / "peak.py"
    script.write_text(code)
    done = subprocess.run([sys.executable, script, folder, out], check=True, capture_output=True, text=True)
    return [int(number) for number in done.stdout.split()[-2:]]


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    for name, value in {"count": 200, "size": 128, "repeat": 3}.items():
        parser.add_argument(f"--{name}", type=int, default=value)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        capture(folder, asked.count, asked.size)
        seconds = {workers: [] for workers in WORKERS}
        for n in range(asked.repeat):
            for workers in WORKERS:
                seconds[workers].append(run(folder, folder / f"{n}_{workers}.zarr", workers))
        one, two = (np.array(seconds[workers]) for workers in WORKERS)
        ratios = one / two
        print(f"{asked.count} measurements of 1 x {FRAMES} x {asked.size} x {asked.size}")
        print(f"one worker {np.median(one):.1f} s, two {np.median(two):.1f} s", end="; ")
        print(f"ratio {np.median(ratios):.2f} ({ratios.min():.2f} to {ratios.max():.2f})", flush=True)
        expected = videos(folder / "0_1.zarr")
        same = expected == videos(folder / "0_2.zarr")
        print(f"one worker and two give the same bits: {same}", flush=True)
        after_kills(folder, expected, asked.count)
        for count in (asked.count // 4, asked.count):
            capture(folder, count, asked.size)
            client, worker = peak(folder, folder / f"memory_{count}.zarr")
            print(
                f"{count} measurements: client {client / 1e6:.0f} MB, worker {worker / 1e6:.0f} MB at most", flush=True
            )


if __name__ == "__main__":
    main()
