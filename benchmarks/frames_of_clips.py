"""PSNR in dB by number of frames, mean over both views and three pairs of clips that are not in the training set.

PNP_SCI_DATA=DIR python benchmarks/frames_of_clips.py

Two views of 256 x 256 pixels, moving masks of density 1/2. The last row is one pair in the case of the paper's largest
real data set: two views of 20 frames of 650 x 650 pixels (clips enlarged to that size) through one moving pattern, with
noise of 0.01 of max(y) and 8 bits. A dash: there are no weights for so many frames.
"""

import os
from pathlib import Path

import cv2
import numpy as np

import pnp_sci
from pnp_sci.bench.methods import Method
from pnp_sci.errors import InputError
from pnp_sci.training.clips import load_clips, split

FRAMES = (6, 10, 14, 20)
LEARNED = ("ofanet", "unet", "admm-net", "birnat")
METHODS = {
    "tv": Method("tv"),
    "desci": Method("desci"),
    "flow": Method("flow"),
    "auto": Method("auto"),
    "best": Method("auto", effort="best"),
    **{name: Method(None, init=name) for name in LEARNED},
}
SIZE, LARGE = 256, 650


def middle(frames, count):
    """The first frames of the central square, (count, 256, 256) in [0, 1]."""
    top, left = ((n - SIZE) // 2 for n in frames.shape[1:])
    return frames[:count, top : top + SIZE, left : left + SIZE] / np.float32(255)


def enlarged(film):
    """Frames (B, 256, 256) as (B, 650, 650)."""
    return np.stack([cv2.resize(frame, (LARGE, LARGE), interpolation=cv2.INTER_CUBIC) for frame in film]).clip(0, 1)


def row(label, cases):
    """Print the mean PSNR and seconds of all methods for (truth, masks, y) of some cases."""
    cells = []
    for method in METHODS.values():
        try:
            results = [method.run(y, masks) for _, masks, y in cases]
        except InputError:
            if method.prior is not None:
                raise
            cells.append("-")
            continue
        psnr = np.mean([pnp_sci.psnr(result.x, truth) for result, (truth, *_) in zip(results, cases)])
        cells.append(f"{psnr:.2f} ({np.mean([result.settings['seconds'] for result in results]):.2g} s)")
    print(f"| {label} | {' | '.join(cells)} |", flush=True)


def main():
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = [c.frames for c in held_out if len(c.frames) >= max(FRAMES) and min(c.frames.shape[1:]) >= SIZE]
    pairs = list(zip(clips, clips[1:] + clips[:1]))[:6:2]
    print(f"| frames | {' | '.join(METHODS)} |\n|---|{'---|' * len(METHODS)}")
    for count in FRAMES:
        masks = pnp_sci.moving_masks((2, count, SIZE, SIZE), seed=count)
        truths = [np.stack([middle(frames, count) for frames in pair]) for pair in pairs]
        row(count, [(truth, masks, pnp_sci.simulate(truth, masks)) for truth in truths])
    truth = np.stack([enlarged(middle(frames, 20)) for frames in pairs[0]])
    masks = pnp_sci.moving_masks(truth.shape, seed=20)
    row(f"20 of {LARGE} x {LARGE}, noise, 8 bits", [(truth, masks, pnp_sci.simulate(truth, masks, 0.01, bits=8))])


if __name__ == "__main__":
    main()
