"""Default parameters against a grid search with the truth, for each scene and noise level: PSNR in dB of both views.

PNP_SCI_DATA=DIR python benchmarks/defaults_against_grid.py [tv] [flow]

The first grid has parameters of the prior, and for tv the number of iterations. The second search, from the best point
of the first, has multiples of the estimated noise.
"""

import itertools
import sys

import numpy as np

import pnp_sci

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
NOISE = (0, 0.01, 0.05, 0.1, 0.2)  # of max(y)
TRUST = (0.5, 0.7, 1.4, 2)  # multiples of the estimated noise
GRIDS = {
    "tv": {"iterations": (50, 100, 200), "time": ("auto", 0.03, 0.1, 0.3)},
    "flow": {"tolerance": (1.8, 2.6, 3.6), "neighbours": (2, 4)},
}


def solved(scene, y, prior, **settings):
    """PSNR in dB, and the estimated noise."""
    result = pnp_sci.solve(y, scene.masks, prior, **settings)
    return float(np.mean(pnp_sci.psnr(result.x, scene.truth))), result.settings["noise"][0]


def main():
    for prior in sys.argv[1:] or GRIDS:
        grid = GRIDS[prior]
        points = [dict(zip(grid, values)) for values in itertools.product(*grid.values())]
        for pair, noise in itertools.product(PAIRS, NOISE):
            scene = pnp_sci.datasets.dualview(pair)
            y = pnp_sci.simulate(scene.truth, scene.masks, noise)
            default, assumed = solved(scene, y, prior)
            # the grid with the estimated noise, then multiples of it at the best point
            best, chosen, times = default, {}, 1
            for point in points:
                psnr, _ = solved(scene, y, prior, noise=assumed, **point)
                if psnr > best:
                    best, chosen = psnr, point
            for multiple in TRUST if noise else ():
                psnr, _ = solved(scene, y, prior, noise=multiple * assumed, **chosen)
                if psnr > best:
                    best, times = psnr, multiple
            words = ", ".join(f"{key} {value}" for key, value in (chosen | {"noise times": times}).items())
            print(
                f"{prior:5} {pair:15} noise {noise:4}: defaults {default:.2f}, grid {best:.2f} dB ({words})", flush=True
            )


if __name__ == "__main__":
    main()
