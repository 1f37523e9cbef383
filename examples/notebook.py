# ruff: noqa: B018
"""
In a notebook
=============

The last line of a cell shows its value: a result shows what it is and how it was obtained.
Download this page as a notebook with the button at its end.
"""

import argparse

import numpy as np

import pnp_sci

options = argparse.ArgumentParser(description="The cells of a notebook.")
options.add_argument("--small", action="store_true", help="64 x 64 pixels, 10 iterations")
args, _ = options.parse_known_args()

scene = pnp_sci.datasets.embedded_scene(64 if args.small else 128)
scene

# %%
# ``reference`` adds the PSNR to the history.
# ``flow`` needs no training: it averages frames along the motion between them.

limit = {"iterations": 10} if args.small else {}
result = pnp_sci.solve(scene.y, scene.masks, prior="flow", reference=scene.truth, **limit)
result

# %%
# Frames of both views, from left to right.

figure = result.plot(frames=[0, 3, 6, 9])
figure

# %%
# The history has a record for each iteration: its residual, and with a reference its PSNR.

course = pnp_sci.plot.plot_history(result)
course

# %%
# A field of the history is an array.

best = np.nanargmax(result.history["psnr"])
print(f"best PSNR {result.history['psnr'][best]:.2f} dB in iteration {result.history[best].iteration}")

# %%
# The scene model says how many frames were modelled, and why.

{name: result.scene[name] for name in ("frames_modelled", "frames", "reason")}
