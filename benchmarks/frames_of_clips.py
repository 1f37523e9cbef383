"""PSNR in dB by number of frames, mean over both views and three pairs of clips that are not in the training set.

PNP_SCI_DATA=DIR python benchmarks/frames_of_clips.py

Two views of 256 x 256 pixels, moving masks of density 1/2.
"""

import os
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.training.clips import load_clips, split

FRAMES = (6, 10, 14, 20)
METHODS = {"tv": ("tv", {}), "flow": ("flow", {}), "auto": ("auto", {}), "best": ("auto", {"effort": "best"})}
SIZE = 256


def middle(frames, count):
    """The first frames of the central square, (count, 256, 256) in [0, 1]."""
    top, left = ((n - SIZE) // 2 for n in frames.shape[1:])
    return frames[:count, top : top + SIZE, left : left + SIZE] / np.float32(255)


def main():
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = [c.frames for c in held_out if len(c.frames) >= max(FRAMES) and min(c.frames.shape[1:]) >= SIZE]
    pairs = list(zip(clips, clips[1:] + clips[:1]))[:6:2]
    print(f"| frames | {' | '.join(METHODS)} |\n|---|{'---|' * len(METHODS)}")
    for count in FRAMES:
        masks = pnp_sci.moving_masks((2, count, SIZE, SIZE), seed=count)
        psnr, seconds = [], []
        for pair in pairs:
            truth = np.stack([middle(frames, count) for frames in pair])
            y = pnp_sci.simulate(truth, masks)
            results = [pnp_sci.solve(y, masks, prior, **settings) for prior, settings in METHODS.values()]
            psnr.append([np.mean(pnp_sci.psnr(result.x, truth)) for result in results])
            seconds.append([result.settings["seconds"] for result in results])
        cells = (f"{p:.2f} ({s:.2g} s)" for p, s in zip(np.mean(psnr, 0), np.mean(seconds, 0)))
        print(f"| {count} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
