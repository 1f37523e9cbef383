"""From a measurement and its masks to two videos: the whole of it on the scene that comes with the package."""

import argparse
from pathlib import Path

import pnp_sci
from pnp_sci.datasets import embedded_scene
from pnp_sci.metrics import psnr, ssim

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="64 x 64 pixels, 10 iterations")
arguments.add_argument("--out", type=Path, default=Path("out"), help="folder for pictures and films")
options = arguments.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

scene = embedded_scene(64 if options.small else 256)
print(scene)

result = pnp_sci.solve(scene.y, scene.masks, prior="tv", iterations=10 if options.small else None)
print(result)
for view, (p, s) in enumerate(zip(psnr(result.x, scene.truth), ssim(result.x, scene.truth)), 1):
    print(f"view {view}: PSNR {p:.2f} dB, SSIM {s:.3f}")

result.plot(reference=scene.truth).savefig(options.out / "quickstart.png")
result.export(options.out / "quickstart.mp4")
result.save(options.out / "quickstart.npz")
again = pnp_sci.Result.load(options.out / "quickstart.npz")
print(f"kept in {options.out / 'quickstart.npz'}: {', '.join(again.settings)}")
