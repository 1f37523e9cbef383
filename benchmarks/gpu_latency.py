"""Seconds of a solve on a device, beside those on the CPU with numba, in turn; pairs a second of a decoder in batches.

python benchmarks/gpu_latency.py [device] [side] [batch]

A noiseless pair of moving squares, 2 views of 10 frames of `side` pixels a side. Medians of three, with the range.
"""

import sys
import time

import numpy as np
import torch

import pnp_sci
from ofanet_init import files
from pnp_sci.accel.inference import ready, running, usable

REPEATS = 3
PRIORS = ("tv", "ffdnet", "auto")


def moving_squares(side):
    """Measurement and masks of two views in which a square moves."""
    truth = np.full((2, 10, side, side), 0.2, np.float32)
    for frame in range(10):
        at = side // 8 + 2 * frame
        truth[0, frame, at : at + side // 4, side // 4 : side // 2] = 0.9
        truth[1, frame, side // 4 : side // 2, at : at + side // 4] = 0.7
    masks = pnp_sci.moving_masks((2, 10, side, side), seed=0)
    return pnp_sci.simulate(truth, masks), masks


def spread(seconds):
    return f"{np.median(seconds):.3g} s ({min(seconds):.3g} to {max(seconds):.3g})"


def solves(device, side):
    y, masks = moving_squares(side)
    ways = {"numba": {"backend": "numba"}, device: {"backend": "torch", "device": device}}
    for prior in PRIORS:
        seconds = {name: [] for name in ways}
        for turn in range(REPEATS + 1):
            for name, how in ways.items():
                result = pnp_sci.solve(y, masks, prior, **how)
                if turn:  # the first one loads and compiles
                    seconds[name].append(result.settings["seconds"])
        print(f"{prior}, {side} x {side}: " + ", ".join(f"{name} {spread(s)}" for name, s in seconds.items()))


def decoding(device, side, batch):
    place = usable(device)
    network, _ = files.load(files.FOLDER / "v2b10.safetensors")
    network = ready(network, place)
    y, masks = (torch.as_tensor(np.float32(a), device=place) for a in moving_squares(side))
    y, masks = y.expand(batch, *y.shape).contiguous(), masks.expand(batch, *masks.shape).contiguous()
    seconds = []
    for turn in range(REPEATS + 1):
        begin = time.perf_counter()
        with running(place):
            network(y, masks, refine=False, orders=2).refined.float().sum().item()  # waits for the device
        if turn:
            seconds.append(time.perf_counter() - begin)
    rates = sorted(batch / s for s in seconds)
    print(f"ofanet-fast, batch of {batch}: {np.median(rates):.3g} pairs/s ({rates[0]:.3g} to {rates[-1]:.3g})")


def main(device="cuda", side=1024, batch=8):
    solves(device, int(side))
    decoding(device, int(side), int(batch))


if __name__ == "__main__":
    main(*sys.argv[1:])
