"""Milliseconds of OFaNet, networks and decoders, for one measurement of 256 x 256 with two views of ten frames.

python benchmarks/ofanet_latency.py [DEVICE]

The calls alternate. The output is the median and range of the milliseconds, and of the ratio to the first row. The
decoders run the separator once for each order of the views.
"""

import sys
import time
from functools import partial

import numpy as np
import torch

import pnp_sci
from ofanet_init import files as _weights
from ofanet_init.decoder import ofanet, ofanet_fast
from pnp_sci.accel.inference import ready, running, usable
from pnp_sci.sensing.operator import SensingOperator
from pnp_sci.sensing.problem import Problem
from pnp_sci.sensing.scene_model import full

LAPS = 10


def milliseconds(call, place):
    """Milliseconds of one call."""
    started = time.perf_counter()
    with running(place):
        call()
    if place.type == "cuda":
        torch.cuda.synchronize(place)
    return 1000 * (time.perf_counter() - started)


def main(device):
    place = usable(device)
    scene = pnp_sci.datasets.embedded_scene(256)
    op, y = SensingOperator(scene.masks.astype(np.float32)), scene.y.astype(np.float32)
    problem, model = Problem(op, y, unit=1.0, noise=0.0), full(op)
    network = ready(_weights.load(_weights.FOLDER / "v2b10.safetensors")[0], place)
    tensors = [torch.from_numpy(a)[None].to(place) for a in (y, op.masks)]
    calls = {
        "network, DA&DNS": partial(network, *tensors, refine=False),
        "network, 1 pass of refine net": partial(network, *tensors, passes=1),
        "network, 2 passes": partial(network, *tensors, passes=2),
        "decoder ofanet-fast": partial(ofanet_fast(device), problem, model),
        "decoder ofanet": partial(ofanet(device), problem, model),
    }
    # without the first two rounds, which load weights and compile kernels
    laps = np.array([[milliseconds(call, place) for call in calls.values()] for _ in range(2 + LAPS)])[2:]
    print(torch.cuda.get_device_name(place) if place.type == "cuda" else "CPU")
    for name, own in zip(calls, laps.T):
        values = ((np.median(a), a.min(), a.max()) for a in (own, own / laps[:, 0]))
        words = ["{:8.1f} ({:.1f} to {:.1f})".format(*of) for of in values]
        print(f"{name:30} {words[0]} ms, {words[1]} times the first")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "cpu")
