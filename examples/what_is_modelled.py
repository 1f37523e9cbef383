"""What is modelled of four scenes, why, and what it brings: moving, one view dark, still, and a saturated camera.

Draws the measurement and a frame of both views, with everything modelled and with what the scene requires.
"""

import argparse
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import pnp_sci

arguments = argparse.ArgumentParser(description=__doc__)
arguments.add_argument("--small", action="store_true", help="128 x 128 pixels and 30 iterations")
arguments.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture")
arguments.add_argument("--prior", default="tv")
options = arguments.parse_args()
options.out.mkdir(parents=True, exist_ok=True)

scene = pnp_sci.datasets.embedded_scene(128 if options.small else 256)
dark, still = scene.truth.copy(), np.repeat(scene.truth[:, :1], scene.truth.shape[1], axis=1)
dark[1] = 0
camera = pnp_sci.Sensor(read_noise=0.0, full_scale=0.6 * float(scene.y.max()))
cases = {
    "both views move": (scene.truth, pnp_sci.Sensor(0.0)),
    "the second view is dark": (dark, pnp_sci.Sensor(0.0)),
    "nothing moves": (still, pnp_sci.Sensor(0.0)),
    "the camera saturates": (scene.truth, camera),
}

figure, axes = plt.subplots(len(cases), 5, figsize=(11, 10), layout="constrained")
for row, (name, (truth, sensor)) in zip(axes, cases.items()):
    y = pnp_sci.simulate(truth, scene.masks, sensor)
    iterations = 30 if options.small else None
    full = pnp_sci.solve(y, scene.masks, options.prior, scene="full", noise=0.0, iterations=iterations)
    auto = pnp_sci.solve(y, scene.masks, options.prior, noise=sensor, iterations=iterations)
    why = auto.scene["reason"]
    if auto.scene["saturated"]:
        why += f"; {auto.scene['saturated']} saturated pixels are bounds"
    print(f"{name}: {auto.scene['frames_modelled']} of {auto.scene['frames']} frames are modelled: {why}")
    row[0].imshow(y, cmap="gray")
    row[0].set_title(f"{name}\n{auto.scene['frames_modelled']} of {auto.scene['frames']} frames modelled", fontsize=9)
    lit = [view for view in range(2) if truth[view].any()]
    for place, (result, label) in enumerate([(full, "all modelled"), (auto, "as required")]):
        psnr = pnp_sci.psnr(result.x, truth)
        for view in range(2):
            panel = row[1 + 2 * view + place]
            panel.imshow(result.x[view, 4], cmap="gray", vmin=0, vmax=1)
            quality = f"{psnr[view]:.1f} dB" if view in lit else f"brightest {result.x[view].max():.2f}"
            panel.set_title(f"view {view + 1}, {label}\n{quality}", fontsize=9)
            print(f"  view {view + 1}, {label}: {quality}")
for panel in axes.flat:
    panel.axis("off")
figure.savefig(options.out / "modelled.jpg", dpi=110)
print(f"Written: {options.out / 'modelled.jpg'}")
