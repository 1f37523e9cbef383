"""Stability of learned priors in 500 iterations with a fixed sigma of 5/255.

The data are the central 128 x 128 pixels of each benchmark pair, without noise. The output is the best PSNR, and the
decrease from it at the end and at worst after it.

PNP_SCI_DATA=DIR python benchmarks/long_runs.py
"""

import numpy as np

import pnp_sci
from pnp_sci import datasets

PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
ITERATIONS = 500
CENTRE = (..., slice(64, 192), slice(64, 192))


def main():
    for prior in ("ffdnet", "video", "tv+ffdnet"):
        for pair in PAIRS:
            scene = datasets.dualview(pair)
            masks, truth = scene.masks[CENTRE], scene.truth[CENTRE]
            result = pnp_sci.solve(
                pnp_sci.simulate(truth, masks), masks, prior, scene="full", noise=0, sigma=5 / 255,
                iterations=ITERATIONS, tol=0, reference=truth,
            )  # fmt: skip
            psnr = np.array([record.psnr for record in result.history])
            best = int(psnr.argmax())
            print(
                f"{prior} on {pair}: best {psnr[best]:.2f} dB after {best} of {len(psnr) - 1} iterations, "
                f"{psnr[best] - psnr[-1]:.2f} less at the end, {psnr[best] - psnr[best:].min():.2f} at worst",
                flush=True,
            )


if __name__ == "__main__":
    main()
