"""Fewer frames and one view: the benchmark pairs with B = 6, and the single-view sets with B = 8; defaults only.

PNP_SCI_DATA=... python benchmarks/frames_and_views.py
"""

import time

import numpy as np
from priors_compared import METHODS, PAIRS

import pnp_sci
from pnp_sci import datasets


def report(title, cases):
    """PSNR of every case (y, masks, truth), their mean, and the seconds of one measurement."""
    for name, method in METHODS.items():
        scores, seconds = [], []
        for y, masks, truth in cases:
            begin = time.perf_counter()
            result = pnp_sci.solve(y, masks, **method)
            seconds.append((time.perf_counter() - begin) / len(y))
            scores.append(np.mean([pnp_sci.psnr(x, t) for x, t in zip(result.x, truth)]))
        each = " ".join(f"{s:.2f}" for s in scores)
        print(f"{title} {name:4} mean {np.mean(scores):.2f} dB ({each}), {np.median(seconds):.2f} s a measurement")


def six_frames(pair):
    """The first six frames of each view, with the first six masks."""
    scene = datasets.dualview(pair)
    masks, truth = scene.masks[:, :6], scene.truth[:, :6]
    return pnp_sci.simulate(truth, masks)[None], masks, truth[None]


def single(name):
    scene = datasets.singleview(name)
    return scene.y, scene.masks, scene.truth


if __name__ == "__main__":
    pnp_sci.solve(*single("kobe")[:2], prior="auto")  # compile and load
    report("B = 6, dual view (" + ", ".join(PAIRS) + "):", [six_frames(pair) for pair in PAIRS])
    report("B = 8, single view (runner, traffic, kobe):", [single(name) for name in ("runner", "traffic", "kobe")])
