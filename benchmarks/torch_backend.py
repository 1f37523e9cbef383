"""PSNR in dB and seconds of the backends torch and numba, in turn, with the largest difference of their PSNR.

PNP_SCI_DATA=DIR python benchmarks/torch_backend.py [device] [prior ...]

Three pairs of clips that are not in the training set, two views of 10 frames of 128 x 128 pixels, moving masks of
density 1/2; and the embedded scene. The first solve of each prior and backend loads and compiles, and does not count.
"""

import os
import sys
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.training.clips import load_clips, split

PRIORS = ("tv", "wavelet", "ffdnet", "video", "flow")
FRAMES, SIZE = 10, 128


def middle(frames):
    """The first frames of the central square, in [0, 1]."""
    top, left = ((n - SIZE) // 2 for n in frames.shape[1:])
    return frames[:FRAMES, top : top + SIZE, left : left + SIZE] / np.float32(255)


def scenes():
    """(y, masks, truth) of three pairs and of the embedded scene."""
    _, held_out = split(load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"]))
    clips = [c.frames for c in held_out if len(c.frames) >= FRAMES and min(c.frames.shape[1:]) >= SIZE]
    masks = pnp_sci.moving_masks((2, FRAMES, SIZE, SIZE), seed=0)
    for pair in zip(clips[:6:2], clips[1:6:2]):
        truth = np.stack([middle(frames) for frames in pair])
        yield pnp_sci.simulate(truth, masks), masks, truth
    embedded = pnp_sci.datasets.embedded_scene(64)
    yield embedded.y, embedded.masks, embedded.truth


def main(device="cpu", *priors):
    settings = {"numba": {"backend": "numba"}, "torch": {"backend": "torch", "device": device}}
    cases = list(scenes())
    print("| prior | numba (dB) | torch (dB) | largest difference | numba (s) | torch (s) |\n|---|---|---|---|---|---|")
    for prior in priors or PRIORS:
        for how in settings.values():
            pnp_sci.solve(*cases[-1][:2], prior, **how)
        psnr, seconds = [], []
        for y, masks, truth in cases:
            results = [pnp_sci.solve(y, masks, prior, **how) for how in settings.values()]
            psnr.append([np.mean(pnp_sci.psnr(result.x, truth)) for result in results])
            seconds.append([result.settings["seconds"] for result in results])
        of_numba, of_torch = np.mean(psnr, 0)
        apart = np.ptp(psnr, 1).max()
        times = " | ".join(f"{s:.2g}" for s in np.mean(seconds, 0))
        print(f"| {prior} | {of_numba:.2f} | {of_torch:.2f} | {apart:.3f} | {times} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
