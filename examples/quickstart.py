"""
Quick start
===========

One coded picture holds two videos of ten frames. This script recovers both.
The scene comes with the package, so that nothing is downloaded.
"""

import argparse
from pathlib import Path

import pnp_sci

options = argparse.ArgumentParser(description="Recover two videos from one coded picture.")
options.add_argument("--small", action="store_true", help="64 x 64 pixels, 10 iterations")
options.add_argument("--out", type=Path, default=Path("out"), help="folder for pictures and videos")
args, _ = options.parse_known_args()
args.out.mkdir(parents=True, exist_ok=True)

# %%
# The measurement
# ---------------
# ``y`` is one picture (H, W). ``masks`` are (V, B, H, W): views, frames, rows, columns.
# Each pixel of ``y`` is the sum of all frames of both views, each times its mask.

scene = pnp_sci.datasets.embedded_scene(64 if args.small else 256)
print(scene)

measured = pnp_sci.plot.plot_video(scene.y[None])

# %%
# Recover the videos
# ------------------
# ``solve`` alternates a step towards the measurement and a denoiser, here total variation.
# The result says how many iterations it took and why it stopped.

result = pnp_sci.solve(scene.y, scene.masks, prior="tv", iterations=10 if args.small else None)
print(result)

# %%
# The truth of this scene is known. Rows alternate between a view and its truth.

for view, (p, s) in enumerate(zip(pnp_sci.psnr(result.x, scene.truth), pnp_sci.ssim(result.x, scene.truth)), 1):
    print(f"view {view}: PSNR {p:.2f} dB, SSIM {s:.3f}")

recovered = result.plot(reference=scene.truth)
recovered.savefig(args.out / "quickstart.png")

# %%
# Keep the result
# ---------------
# The file holds the video, the history and the settings. A video file is for looking at.

result.export(args.out / "quickstart.mp4")
result.save(args.out / "quickstart.npz")
again = pnp_sci.Result.load(args.out / "quickstart.npz")
print(f"settings that were saved: {', '.join(again.settings)}")

# sphinx_gallery_thumbnail_number = 2
