"""
A real capture: the wheel
=========================

A chopper wheel with a letter D turns before a CACTI camera. 14 frames come from one picture, one view.
The capture is downloaded on first use, or taken from the folder ``PNP_SCI_DATA``.

.. image:: /pictures/wheel.jpg
   :alt: frames recovered by several priors
"""

import argparse
from pathlib import Path

import pnp_sci
from pnp_sci.errors import DataUnavailableError

options = argparse.ArgumentParser(description="14 frames of a turning wheel from one picture.")
options.add_argument("--small", action="store_true", help="10 iterations")
options.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture and the video")
options.add_argument("--prior", default="auto")
args, _ = options.parse_known_args()
args.out.mkdir(parents=True, exist_ok=True)

try:
    scene = pnp_sci.datasets.real("wheel")
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = pnp_sci.datasets.embedded_scene(64 if args.small else 256)
print(scene)

# %%
# A report on the masks: their density, closed pixels, and how alike they are.

print(pnp_sci.condition(scene.masks))

# %%
# There is no truth to compare with: look at the picture.

result = pnp_sci.solve(scene.y, scene.masks, args.prior, iterations=10 if args.small else None)
print(result)
figure = result.plot(frames=range(1, scene.masks.shape[1] - 1, 2))
figure.savefig(args.out / "wheel.png", dpi=150)
result.export(args.out / "wheel.mp4", fps=7)

# sphinx_gallery_thumbnail_path = "pictures/wheel.jpg"
