"""The same measurement with several priors: quality, time, and a picture for the eye."""

import argparse
import time
from pathlib import Path

import pnp_sci
from pnp_sci.datasets import dualview, embedded_scene
from pnp_sci.errors import DataUnavailableError
from pnp_sci.metrics import psnr, ssim

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="the embedded scene with 64 x 64 pixels, 10 iterations")
arguments.add_argument("--out", type=Path, default=Path("out"), help="folder for the pictures")
arguments.add_argument("--pair", default="hike_hockey", help="pair of the dual-view benchmark")
arguments.add_argument("--priors", nargs="+", default=["tv", "wavelet", "tv+wavelet"])
options = arguments.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

try:
    scene = embedded_scene(64) if options.small else dualview(options.pair)
except DataUnavailableError as error:
    print(f"{error}\nThe embedded scene takes its place.")
    scene = embedded_scene()
print(scene)

for prior in options.priors:
    start = time.perf_counter()
    result = pnp_sci.solve(scene.y, scene.masks, prior, iterations=10 if options.small else None)
    seconds = time.perf_counter() - start
    scores = " / ".join(
        f"{p:.2f} dB, {s:.3f}" for p, s in zip(psnr(result.x, scene.truth), ssim(result.x, scene.truth))
    )
    print(f"{prior:12s} {scores}   {seconds:6.2f} s   {result.status.value}")
    result.plot(reference=scene.truth).savefig(options.out / f"compare_{prior}.png")
