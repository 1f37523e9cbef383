"""tv, flow, video and auto on the benchmark pairs, with the noise of the paper's protocol, and on the real wheel.

PNP_SCI_DATA=... python benchmarks/priors_compared.py
"""

import time

import numpy as np

import pnp_sci
from pnp_sci import datasets, io

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
METHODS = {
    "tv": {"prior": "tv"},
    "flow": {"prior": "flow"},
    "video": {"prior": "video"},
    "auto": {"prior": "auto"},
    "best": {"prior": "auto", "effort": "best"},
}


def pairs(noise):
    """Mean PSNR over the six videos and the median seconds a pair, defaults only."""
    for name, method in METHODS.items():
        scores, seconds = [], []
        for pair in PAIRS:
            scene = datasets.dualview(pair)
            y = pnp_sci.simulate(scene.truth, scene.masks, noise=noise)
            begin = time.perf_counter()
            result = pnp_sci.solve(y, scene.masks, **method)
            seconds.append(time.perf_counter() - begin)
            scores += list(pnp_sci.psnr(result.x, scene.truth))
        videos = " ".join(f"{s:.2f}" for s in scores)
        print(f"noise {noise:<4} {name:4} mean {np.mean(scores):.2f} dB ({videos}), {np.median(seconds):.2f} s a pair")


def wheel():
    """Correlation of each frame with another decoder's published result, which is no truth; frames 3 to 12."""
    scene = datasets.real("wheel")
    other = io.read(datasets.fetch("real/BIRNAT_wheel.mat"), "pic")[::-1]
    for name, method in METHODS.items():
        x = pnp_sci.solve(scene.y, scene.masks, **method).x[0]
        same = [np.corrcoef(a.ravel(), b.ravel())[0, 1] for a, b in zip(x, other)][2:12]
        print(f"wheel {name:4} correlation {min(same):.3f} ... {max(same):.3f}")


def main():
    scene = datasets.embedded_scene(64)
    pnp_sci.solve(scene.y, scene.masks, "video", iterations=32)  # compile and load
    for noise in (0.0, 0.01, 0.05, 0.1, 0.2):
        pairs(noise)
    wheel()


if __name__ == "__main__":
    main()
