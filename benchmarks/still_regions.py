"""Gain in dB from the detection of still pixels (option ``still`` of the priors), for static and moving cameras.

PNP_SCI_DATA=DIR python benchmarks/still_regions.py [tv] [flow]

Pairs of clips, 192 x 192 pixels, held-out clips first. A pixel is still if its standard deviation along time is below
2.5/255. Each line has the fractions of still pixels in the truth and of those found, PSNR without detection, and gain.
"""

import os
import sys
from pathlib import Path

import numpy as np

import pnp_sci
from pnp_sci.training.clips import load_clips

PAIRS = (
    ("davis_tennis", "skating_arena"), ("kayak_lake_1", "davis_dance-twirl"), ("forest_trek_1", "vid4_city"),
    ("aspen_leaf", "cot_cat"), ("paris_square_1", "sam2_bedroom_1"), ("dance_room_1", "gym_2"),
    ("davis_mallard-water", "iot_cars_2"), ("sam2_juggle_1", "bird_bath_2"), ("hammer_tv_1", "highway_drive_2"),
)  # fmt: skip
SIZE, FRAMES = 192, 10


def middle(frames):
    """The first frames of the central square, (10, 192, 192) in [0, 1]."""
    top, left = ((n - SIZE) // 2 for n in frames.shape[1:])
    return frames[:FRAMES, top : top + SIZE, left : left + SIZE] / np.float32(255)


def main():
    clips = {clip.name: clip.frames for clip in load_clips([Path(os.environ["PNP_SCI_DATA"]) / "train_video"])}
    for prior in sys.argv[1:] or ("tv", "flow"):
        gains = []
        for names in PAIRS:
            truth = np.stack([middle(clips[name]) for name in names])
            masks = pnp_sci.moving_masks(truth.shape, seed=1)
            y = pnp_sci.simulate(truth, masks)
            with_it, without = (pnp_sci.solve(y, masks, prior, scene="full", still=still) for still in (True, False))
            plain = pnp_sci.psnr(without.x, truth)
            gains.append(pnp_sci.psnr(with_it.x, truth) - plain)
            for name, view, found, psnr, gain in zip(names, truth, with_it.scene["at_rest"], plain, gains[-1]):
                still = np.mean(view.std(0) < 2.5 / 255)
                print(f"{prior:5} {name:20} {still:.2f} still, {found:.2f} found: {psnr:.2f} {gain:+.2f}", flush=True)
        print(f"{prior:5} mean {np.mean(gains):+.2f}, from {np.min(gains):+.2f} to {np.max(gains):+.2f}", flush=True)


if __name__ == "__main__":
    main()
