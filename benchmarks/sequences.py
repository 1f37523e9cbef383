"""Consecutive measurements solved as one video, against each alone: dB, the change where measurements meet, seconds.

The folder ``PNP_SCI_DATA`` holds the data sets. The jump is the change from frame to frame where two measurements meet,
divided by that within measurements, and by the same of the truth: 1 is none.

    python benchmarks/sequences.py [PRIORS] [MEASUREMENTS]
"""

import statistics
import sys
import time

import numpy as np

import pnp_sci
from pnp_sci.datasets import singleview

RUNS = 4  # of each, alternating; the first compiles and does not count
WINDOWS = 3, 4  # measurements


def jump(x: np.ndarray) -> float:
    """Change between the last frame of a measurement and the first of the next, over that within; x (N, 1, B, H, W)."""
    frames = x.shape[2]
    change = np.abs(np.diff(x.reshape(-1, *x.shape[-2:]), axis=0)).mean((1, 2))
    meets = np.arange(len(change)) % frames == frames - 1
    return float(change[meets].mean() / change[~meets].mean())


def main() -> None:
    priors = sys.argv[1].split(",") if len(sys.argv) > 1 else ["tv", "flow", "video"]
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 4
    print("| scene | prior | apart (dB) | together | gain | jump apart | together | seconds apart | together | ratio |")
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for name in ("traffic", "runner"):
        scene = singleview(name)
        y, truth = np.asarray(scene.y)[:count], np.asarray(scene.truth)[:count]
        for prior in priors:
            seconds, results = {False: [], True: []}, {}
            for _ in range(RUNS):
                for sequence in (False, True):
                    begin = time.perf_counter()
                    results[sequence] = pnp_sci.solve(y, scene.masks, prior, sequence=sequence).x
                    seconds[sequence].append(time.perf_counter() - begin)
            apart, together = (
                float(np.mean([pnp_sci.psnr(*pair) for pair in zip(results[s], truth)])) for s in (False, True)
            )
            jumps = [jump(results[s]) / jump(truth) for s in (False, True)]
            times = [min(seconds[s]) for s in (False, True)]
            ratio = statistics.median(b / a for a, b in zip(seconds[False][1:], seconds[True][1:]))
            print(
                f"| {name} | {prior} | {apart:.2f} | {together:.2f} | {together - apart:+.2f} | {jumps[0]:.3f} "
                f"| {jumps[1]:.3f} | {times[0]:.1f} | {times[1]:.1f} | {ratio:.2f} |",
                flush=True,
            )


def windows(priors: list[str]) -> None:
    """All measurements of a set together, and in windows."""
    print("\n| scene | prior | one window | " + " | ".join(f"windows of {n}" for n in WINDOWS) + " |")
    print("| --- | --- | --- |" + " --- |" * len(WINDOWS))
    for name in ("traffic", "runner"):
        scene = singleview(name)
        y, truth = np.asarray(scene.y), np.asarray(scene.truth)
        for prior in priors:
            videos = [pnp_sci.solve(y, scene.masks, prior, sequence=n).x for n in (True, *WINDOWS)]
            scores = [np.mean([pnp_sci.psnr(*pair) for pair in zip(x, truth)]) for x in videos]
            print(
                f"| {name}, {len(y)} measurements | {prior} | " + " | ".join(f"{s:.2f}" for s in scores) + " |",
                flush=True,
            )


if __name__ == "__main__":
    main()
    windows(sys.argv[1].split(",") if len(sys.argv) > 1 else ["tv", "flow"])
