"""Spearman rank correlation over methods between PSNR and the held-back score, which needs no truth, for each pair.

PNP_SCI_DATA=DIR python benchmarks/score_against_truth.py [--fraction 0.05] [--noise 0] [--slow]
"""

import argparse

import numpy as np
from scipy.stats import spearmanr

import pnp_sci
from pnp_sci import SceneModel, datasets
from pnp_sci.bench import held_back_score

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
QUICK = {
    "none": {"prior": "none"},
    "tv": {"prior": "tv"},
    "tv, 5 iterations": {"prior": "tv", "iterations": 5},
    "tv, 10 iterations": {"prior": "tv", "iterations": 10},
    "tv, 20 iterations": {"prior": "tv", "iterations": 20},
    "tv, plain-gap": {"prior": "tv", "algorithm": "plain-gap"},
    "tv, frame by frame": {"prior": "tv", "time": 0},
    "tv, strength 4": {"prior": "tv", "strength": 4.0},
    "tv, strength 1/4": {"prior": "tv", "strength": 0.25},
    "wavelet": {"prior": "wavelet"},
    "wavelet, frame by frame": {"prior": "wavelet", "time": 0},
    "flow": {"prior": "flow"},
    "flow, fast": {"prior": "flow", "effort": "fast"},
}
SLOW = {"ffdnet": {"prior": "ffdnet"}, "video": {"prior": "video"}}


def figures(scene, y, method, fraction):
    """Mean PSNR, score, PSNR of the reconstruction without the held-back pixels, and relative residual."""
    result = pnp_sci.solve(y, scene.masks, **method)
    known = {"noise": result.settings["noise"][0], "scene": SceneModel(**kept(result.scene))}
    known["init"] = result.settings["init"]
    partial = []

    def reconstruct(y, masks):
        partial.append(pnp_sci.solve(y, masks, **method, **known).x)
        return partial[0]

    score = held_back_score(reconstruct, y, scene.masks, noise=known["noise"], fraction=fraction)
    psnr, without = (float(np.mean(pnp_sci.psnr(x, scene.truth))) for x in (result.x, partial[0]))
    return psnr, score, without, result.history[-1].residual


def kept(scene):
    return {key: scene[key] for key in ("views", "still", "reason")}


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--fraction", type=float, default=0.05, help="fraction of held-back pixels")
    arguments.add_argument("--noise", type=float, default=0.0, help="standard deviation, of max(y)")
    arguments.add_argument("--slow", action="store_true", help="networks too: minutes per pair")
    options = arguments.parse_args()
    methods = QUICK | (SLOW if options.slow else {})
    correlations = []
    for pair in PAIRS:
        scene = datasets.dualview(pair)
        y = pnp_sci.simulate(scene.truth, scene.masks, noise=options.noise)
        rows = {name: figures(scene, y, method, options.fraction) for name, method in methods.items()}
        print(f"{pair}: PSNR, score, PSNR without the held-back pixels, residual")
        for name, (psnr, score, without, residual) in sorted(rows.items(), key=lambda item: -item[1][0]):
            print(f"  {name:24} {psnr:6.2f} {score:6.2f} {without:6.2f} {residual:.4f}")
        psnrs, scores, _, residuals = zip(*rows.values())
        correlations.append(spearmanr(psnrs, scores).statistic)
        of_residual = spearmanr(psnrs, -np.array(residuals)).statistic
        print(f"  rank correlation with PSNR: score {correlations[-1]:.3f}, residual {of_residual:.3f}", flush=True)
    print(f"median rank correlation of the score: {np.median(correlations):.3f}, smallest {min(correlations):.3f}")


if __name__ == "__main__":
    main()
