"""A capture of a real camera: a chopper wheel with a letter D turns, 14 frames from one picture, one view."""

import argparse
from pathlib import Path

import pnp_sci
from pnp_sci.datasets import embedded_scene, real
from pnp_sci.errors import DataUnavailableError
from pnp_sci.masks import condition

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="10 iterations")
arguments.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture and the film")
arguments.add_argument("--prior", default="auto")
options = arguments.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

try:
    scene = real("wheel")
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = embedded_scene(64 if options.small else 256)
print(scene)
print(condition(scene.masks))

result = pnp_sci.solve(scene.y, scene.masks, options.prior, iterations=10 if options.small else None)
print(result)
result.plot(frames=range(1, scene.masks.shape[1] - 1, 2)).savefig(options.out / "wheel.png", dpi=150)
result.export(options.out / "wheel.mp4", fps=7)
print(f"Written: {options.out / 'wheel.png'}, {options.out / 'wheel.mp4'}")
