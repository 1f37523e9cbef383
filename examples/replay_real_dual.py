"""
Two real captures in one
========================

Light adds up. So the sum of two captures is what a dual-view camera would have measured, noise included.
A wheel and a hand are separated again, 14 frames each.

.. image:: /pictures/real_dual.jpg
   :alt: frames recovered by several priors
"""

import argparse
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.errors import DataUnavailableError

options = argparse.ArgumentParser(description="A wheel and a hand from one picture.")
options.add_argument("--small", action="store_true", help="10 iterations")
options.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture and the video")
options.add_argument("--prior", default="auto")
args, _ = options.parse_known_args()
args.out.mkdir(parents=True, exist_ok=True)

try:
    scene = pnp_sci.datasets.real_dual()
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = pnp_sci.datasets.embedded_scene(64 if args.small else 256)
print(scene)

# %%
# The report says whether the masks can tell the views apart.

print(pnp_sci.condition(scene.masks))

# %%
# A view that is brighter than expected, or full of the other view's edges, is a sign of wrong masks.

result = pnp_sci.solve(scene.y, scene.masks, args.prior, iterations=10 if args.small else None)
print(result)
for view, video in enumerate(result.x, 1):
    print(f"view {view}: values from {video.min():.3g} to {video.max():.3g}, median {np.median(video):.3g}")
figure = result.plot(frames=range(1, scene.masks.shape[1] - 1, 2))
figure.savefig(args.out / "dual.png", dpi=150)
result.export(args.out / "dual.mp4", fps=7)

# sphinx_gallery_thumbnail_path = "pictures/real_dual.jpg"
