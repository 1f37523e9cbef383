"""
Compare priors
==============

One measurement, several priors: PSNR, time, and a picture for the eye.
With ``--pair hike_hockey`` the script takes a pair of the dual-view benchmark instead of the embedded scene.
"""

import argparse
import time
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import pnp_sci
from pnp_sci.errors import DataUnavailableError

options = argparse.ArgumentParser(description="One measurement, several priors.")
options.add_argument("--small", action="store_true", help="64 x 64 pixels, 10 iterations")
options.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture")
options.add_argument("--pair", help="pair of the dual-view benchmark")
options.add_argument("--priors", nargs="+", default=["none", "tv", "wavelet", "flow"])
args, _ = options.parse_known_args()
args.out.mkdir(parents=True, exist_ok=True)

try:
    scene = pnp_sci.datasets.dualview(args.pair) if args.pair else None
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = None
scene = scene or pnp_sci.datasets.embedded_scene(64 if args.small else 256)
print(scene)

# %%
# The first call of a prior compiles its kernels. The seconds are those of a second call.

results, labels = [], []
for prior in args.priors:
    pnp_sci.solve(scene.y, scene.masks, prior, iterations=2)
    start = time.perf_counter()
    results.append(pnp_sci.solve(scene.y, scene.masks, prior, iterations=10 if args.small else None))
    seconds = time.perf_counter() - start
    psnr, ssim = (np.mean(metric(results[-1].x, scene.truth)) for metric in (pnp_sci.psnr, pnp_sci.ssim))
    labels.append(f"{prior}: {psnr:.1f} dB, {seconds:.1f} s")
    print(f"{labels[-1]}, SSIM {ssim:.3f}, {results[-1].status.value}")

# %%
# The middle frame of both views. The last column is the truth.

figure = Figure(figsize=(2.6 * (len(results) + 1), 5.6), layout="constrained")
axes = figure.subplots(2, len(results) + 1)
for column, video, label in zip(axes.T, [*(r.x for r in results), scene.truth], [*labels, "truth"]):
    for panel, view in zip(column, video):
        panel.imshow(view[len(view) // 2], cmap="gray", vmin=0, vmax=1)
        panel.axis("off")
    column[0].set_title(label, fontsize=9)
figure.savefig(args.out / "compare.png")
