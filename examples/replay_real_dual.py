"""Two captures of a real camera in one measurement, noise included: a wheel and a hand are told apart again.

Light adds up, so the sum of two captures is what a dual-view camera would have measured.
"""

import argparse
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.datasets import embedded_scene, real_dual
from pnp_sci.errors import DataUnavailableError
from pnp_sci.masks import condition

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="10 iterations")
arguments.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture and the film")
arguments.add_argument("--prior", default="auto")
options = arguments.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

try:
    scene = real_dual()
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = embedded_scene(64 if options.small else 256)
print(scene)
print(condition(scene.masks))

result = pnp_sci.solve(scene.y, scene.masks, options.prior, iterations=10 if options.small else None)
print(result)
for view, film in enumerate(result.x, 1):
    print(f"view {view}: values from {film.min():.3g} to {film.max():.3g}, median {np.median(film):.3g}")
result.plot(frames=range(1, scene.masks.shape[1] - 1, 2)).savefig(options.out / "dual.png", dpi=150)
result.export(options.out / "dual.mp4", fps=7)
print(f"Written: {options.out / 'dual.png'}, {options.out / 'dual.mp4'}")
