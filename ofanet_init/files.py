"""Weights of OFaNet: files that carry their configuration."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from ofanet_init.config import OFaNetConfig
from ofanet_init.network import OFaNet
from pnp_sci.accel import weights

FOLDER = Path(__file__).with_name("weights")


def save(path: str | Path, network: OFaNet) -> str:
    """Write the weights of `network` to `path`, at once or not at all; return the hash of their values."""
    return weights.save(path, network.state_dict(), {"model": "ofanet", "config": json.dumps(asdict(network.config))})


def load(path: str | Path) -> tuple[OFaNet, str]:
    """Read a network from `path`, and the hash of its weights; errors as of :func:`pnp_sci.accel.weights.read`."""
    tensors, metadata = weights.read(path, {"model": "ofanet"}, "python -m ofanet_init.train")
    network = OFaNet(OFaNetConfig(**json.loads(metadata["config"])))
    weights.fill(network, tensors, path)
    return network.eval(), metadata["sha256"]


def start(network: OFaNet, path: str | Path) -> None:
    """Take over those weights in `path` that `network` has too: of an earlier stage, or of another configuration.

    Of kernels for another number of frames the block that both have. With other views, or without the amplifier, the
    planes in it mean something else: a start all the same.
    """
    tensors, _ = weights.read(path, {"model": "ofanet"}, "python -m ofanet_init.train")
    own = network.state_dict()
    for key in own.keys() & tensors.keys():
        if own[key].ndim == tensors[key].ndim:
            block = tuple(slice(min(sizes)) for sizes in zip(own[key].shape, tensors[key].shape))
            own[key][block] = tensors[key][block]
