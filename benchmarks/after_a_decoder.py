"""Whether a strong prior needs a warm-up after a decoder: PSNR in dB by noise of max(y), mean over validation clips.

PNP_SCI_DATA=DIR python benchmarks/after_a_decoder.py [VxB ...]

Crops of 128 x 128 pixels, by default of one view of 8 frames and two views of 10. "adjoint" and "given" begin with
total variation: "given" from the decoder's video as an array, which solve() cannot tell from any other estimate.
"named" begins with the prior; with noise the decoder has its share of the result.
"""

import os
import sys
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.training.clips import load_clips, split

DECODER, SIZE, NOISES = "ofanet-fast", 128, (0.0, 0.01, 0.05, 0.1)


def scenes(views, frames):
    """Every third held-out clip, with those that follow as further views."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = [c.frames for c in held_out if len(c.frames) >= frames and min(c.frames.shape[1:]) >= SIZE]
    for n in range(0, len(clips), 3):
        chosen = (clips[(n + view) % len(clips)] for view in range(views))
        yield np.stack([middle(clip, frames) for clip in chosen])


def middle(clip, frames):
    top, left = ((n - SIZE) // 2 for n in clip.shape[1:])
    return clip[:frames, top : top + SIZE, left : left + SIZE] / np.float32(255)


def main():
    setups = [tuple(map(int, given.split("x"))) for given in sys.argv[1:]] or [(1, 8), (2, 10)]
    print("| scene | prior | noise | adjoint | given | named |\n|---|---|---|---|---|---|")
    for views, frames in setups:
        masks = pnp_sci.moving_masks((views, frames, SIZE, SIZE), seed=3)
        truths = list(scenes(views, frames))
        for prior in ("flow", "video"):
            for noise in NOISES:
                scores = []
                for truth in truths:
                    y = pnp_sci.simulate(truth, masks, noise)
                    inits = "adjoint", pnp_sci.decode(y, masks, model=DECODER).x, DECODER
                    results = (pnp_sci.solve(y, masks, prior, init=init) for init in inits)
                    scores.append([np.mean(pnp_sci.psnr(result.x, truth)) for result in results])
                means = " | ".join(f"{value:.2f}" for value in np.mean(scores, axis=0))
                print(f"| {views} x {frames} | `{prior}` | {noise:g} | {means} |", flush=True)


if __name__ == "__main__":
    main()
