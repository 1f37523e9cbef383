"""
What is modelled of a scene
===========================

``solve`` finds out what has to be modelled: views that are dark, and scenes that stand still, have fewer unknowns.
This script solves four scenes with everything modelled, and with what the scene requires.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import pnp_sci

options = argparse.ArgumentParser(description="Four scenes, and what is modelled of each.")
options.add_argument("--small", action="store_true", help="128 x 128 pixels and 30 iterations")
options.add_argument("--out", type=Path, default=Path("out"), help="folder for the picture")
options.add_argument("--prior", default="tv")
args, _ = options.parse_known_args()
args.out.mkdir(parents=True, exist_ok=True)

# %%
# The scenes: both views move, the second view is dark, nothing moves, the camera saturates.

scene = pnp_sci.datasets.embedded_scene(128 if args.small else 256)
dark, still = scene.truth.copy(), np.repeat(scene.truth[:, :1], scene.truth.shape[1], axis=1)
dark[1] = 0
ideal, clipping = pnp_sci.Sensor(0.0), pnp_sci.Sensor(0.0, full_scale=0.6 * float(scene.y.max()))
cases = {
    "both views move": (scene.truth, ideal),
    "the second view is dark": (dark, ideal),
    "nothing moves": (still, ideal),
    "the camera saturates": (scene.truth, clipping),
}

# %%
# Each row: the measurement, then a frame of both views by the full model and by the one that was chosen.

figure = Figure(figsize=(11, 10), layout="constrained")
for row, (name, (truth, sensor)) in zip(figure.subplots(len(cases), 5), cases.items()):
    y = pnp_sci.simulate(truth, scene.masks, sensor)
    limit = {"iterations": 30} if args.small else {}
    full = pnp_sci.solve(y, scene.masks, args.prior, scene="full", noise=0.0, **limit)
    auto = pnp_sci.solve(y, scene.masks, args.prior, noise=sensor, **limit)
    print(f"{name}: {auto.scene['frames_modelled']} of {auto.scene['frames']} frames. {auto.scene['reason']}")
    row[0].imshow(y, cmap="gray")
    row[0].set_title(f"{name}\n{auto.scene['frames_modelled']} of {auto.scene['frames']} frames", fontsize=9)
    for place, (result, label) in enumerate([(full, "full"), (auto, "chosen")]):
        for view, psnr in enumerate(pnp_sci.psnr(result.x, truth)):
            panel = row[1 + 2 * view + place]
            panel.imshow(result.x[view, 4], cmap="gray", vmin=0, vmax=1)
            quality = f"{psnr:.1f} dB" if truth[view].any() else f"brightest {result.x[view].max():.2f}"
            panel.set_title(f"view {view + 1}, {label}\n{quality}", fontsize=9)
    for panel in row:
        panel.axis("off")
figure.savefig(args.out / "modelled.jpg", dpi=110)
