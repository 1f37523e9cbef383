"""GAP-TV of pnp-sci against a reference loop of numpy and scikit-image: PSNR per video and ratio of the times.

The reference is the loop of published scripts: projection in numpy, `denoise_tv_chambolle` with all planes as channels,
weight 0.1, and 50 accelerated iterations with 5 inner ones. Both alternate; the output is the median of the ratios.

    PNP_SCI_DATA=DIR python benchmarks/tv_against_reference.py
"""

import statistics
import time

import numpy as np
from skimage.restoration import denoise_tv_chambolle

import pnp_sci

REPEATS = 5
PAIRS = ("bear_blackswan", "car-b_car-w", "hike_hockey")
PEERS = {"bear_blackswan": (23.85, 24.24), "car-b_car-w": (21.52, 22.10), "hike_hockey": (22.43, 23.93)}  # dB


def reference_loop(y, masks):
    planes = masks.reshape(-1, *y.shape).transpose(1, 2, 0).astype(np.float32)
    gram = np.maximum((planes**2).sum(-1), 1e-6)
    x, accumulated = planes * (y / gram)[..., None], np.zeros_like(y)
    for _ in range(50):
        measured = (planes * x).sum(-1)
        accumulated += y - measured
        x = x + planes * ((accumulated - measured) / gram)[..., None]
        x = denoise_tv_chambolle(x, weight=0.1, max_num_iter=5, channel_axis=-1).astype(np.float32)
    return x.transpose(2, 0, 1).reshape(masks.shape)


def timed(function):
    begin = time.perf_counter()
    value = function()
    return value, time.perf_counter() - begin


def main():
    scores, ratios = [], []
    for pair in PAIRS:
        scene = pnp_sci.datasets.dualview(pair)
        pnp_sci.solve(scene.y, scene.masks, iterations=2)  # compile
        ours, theirs = [], []
        for _ in range(REPEATS):
            result, seconds = timed(lambda s=scene: pnp_sci.solve(s.y, s.masks, prior="tv"))
            ours.append(seconds)
            other, seconds = timed(lambda s=scene: reference_loop(s.y, s.masks))
            theirs.append(seconds)
        psnr, psnr_other = pnp_sci.psnr(result.x, scene.truth), pnp_sci.psnr(other, scene.truth)
        ratio = statistics.median(a / b for a, b in zip(ours, theirs))
        scores += list(psnr)
        ratios.append(ratio)
        for view, peer in enumerate(PEERS[pair]):
            name = pair.split("_")[view]
            print(f"{name:10} ours {psnr[view]:.2f} dB, loop {psnr_other[view]:.2f}, peers' script {peer:.2f}")
        spread = f"{min(ours):.3f} ... {max(ours):.3f}"
        print(
            f"  {statistics.median(ours):.3f} s ({spread}), loop {statistics.median(theirs):.3f} s: ratio {ratio:.3f}"
        )
    print(f"average {np.mean(scores):.2f} dB; time {statistics.median(ratios):.3f} of the reference loop's")


if __name__ == "__main__":
    main()
