"""Milliseconds of OFaNet for one measurement of 256 x 256, two views of ten frames: networks and whole decoders.

python benchmarks/ofanet_latency.py [DEVICE]
"""

import statistics
import sys
import time
from functools import partial

import numpy as np
import torch

import pnp_sci
from ofanet_init import _weights
from ofanet_init.decoder import ofanet, ofanet_fast
from pnp_sci.inference import ready, running, usable
from pnp_sci.operator import SensingOperator

LAPS = 10


def milliseconds(call, place):
    """Median of LAPS laps after two that load and compile."""
    laps = []
    for _ in range(2 + LAPS):
        started = time.perf_counter()
        call()
        if place.type == "cuda":
            torch.cuda.synchronize(place)
        laps.append(1000 * (time.perf_counter() - started))
    return statistics.median(laps[2:])


def main(device):
    place = usable(device)
    scene = pnp_sci.datasets.embedded_scene(256)
    op, y = SensingOperator(scene.masks.astype(np.float32)), scene.y.astype(np.float32)
    network = ready(_weights.load(_weights.FOLDER / "v2b10.safetensors")[0], place)
    tensors = [torch.from_numpy(a)[None].to(place) for a in (y, op.masks)]
    print(torch.cuda.get_device_name(place) if place.type == "cuda" else "CPU")
    with running(place):
        print(f"forward pass of DA&DNS       {milliseconds(partial(network, *tensors, refine=False), place):8.1f} ms")
        for passes in (1, 2):
            taken = milliseconds(partial(network, *tensors, passes=passes), place)
            print(f"forward pass, {passes} refining    {taken:8.1f} ms")
    for decoder in (ofanet_fast, ofanet):
        taken = milliseconds(partial(decoder, op, y, device=device), place)
        print(f"decoder {decoder.__name__:<12} {taken:16.1f} ms")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "cpu")
