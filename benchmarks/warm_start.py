"""What a warm start is worth: PSNR after some iterations, and time to the cold start's end, on the dual-view pairs.

PNP_SCI_DATA=... python benchmarks/warm_start.py [--priors tv,flow] [--inits adjoint,ofanet-fast]
"""

import argparse

import numpy as np

import pnp_sci
from pnp_sci import datasets

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
AFTER = (5, 10, 20, 50, 100)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--priors", default="tv,flow")
    parser.add_argument("--inits", default="adjoint,ofanet-fast")
    options = parser.parse_args()
    inits = options.inits.split(",")
    scenes = [datasets.dualview(pair) for pair in PAIRS]
    for init in inits:
        if init != "adjoint":
            pnp_sci.decode(scenes[0].y, scenes[0].masks, model=init)  # loads and compiles
            runs = [pnp_sci.decode(s.y, s.masks, model=init) for s in scenes]
            alone = [np.mean(pnp_sci.metrics.psnr(r.x, s.truth)) for r, s in zip(runs, scenes)]
            print(f"{init} alone: {np.mean(alone):.2f} dB, {np.mean([r.history[-1].seconds for r in runs]):.2f} s")
    for prior in options.priors.split(","):
        goal = {}
        for init in inits:
            histories = []
            for scene in scenes:
                pnp_sci.solve(scene.y, scene.masks, prior=prior, iterations=1)
                result = pnp_sci.solve(scene.y, scene.masks, prior=prior, init=init, reference=scene.truth)
                histories.append(result.history)
            curve = [np.mean([h["psnr"][min(n, len(h) - 1)] for h in histories]) for n in AFTER]
            reached = []
            for pair, history in zip(PAIRS, histories):
                goal.setdefault(pair, history[-1].psnr)
                there = np.flatnonzero(history["psnr"] >= goal[pair] - 0.05)
                reached.append(history["seconds"][there[0]] if there.size else np.inf)
            print(
                f"{prior} from {init}: "
                + ", ".join(f"{p:.2f} dB after {n}" for n, p in zip(AFTER, curve))
                + f"; within 0.05 dB of {inits[0]}'s end after {np.mean(reached):.2f} s"
            )


if __name__ == "__main__":
    main()
