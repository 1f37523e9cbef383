"""Weights of OFaNet: safetensors files with the configuration in their metadata."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

from ofanet_init.config import OFaNetConfig
from ofanet_init.network import OFaNet
from pnp_sci.errors import FormatError
from pnp_sci.formats import weights

FOLDER = Path(__file__).with_name("weights")


def save(path: str | Path, network: OFaNet) -> str:
    """Write the weights of `network` to `path` atomically; return the SHA-256 of their values."""
    return weights.save(path, network.state_dict(), {"model": "ofanet", "config": json.dumps(asdict(network.config))})


def load(path: str | Path) -> tuple[OFaNet, str]:
    """Read a network from `path`, with the SHA-256 of its weights; raises as :func:`pnp_sci.formats.weights.read`."""
    tensors, metadata = weights.read(path, {"model": "ofanet"}, "python -m ofanet_init.train")
    fields = weights.described(metadata, "config", tensors, path)
    try:
        network = OFaNet(OFaNetConfig(**fields))
    except (TypeError, ValueError) as error:
        raise FormatError(f"{path} has no valid configuration in its metadata: {error!r}") from error
    weights.fill(network, tensors, path)
    return network.eval(), metadata["sha256"]


def start(network: OFaNet, path: str | Path) -> None:
    """Initialise `network` with the weights in `path` whose names it has: an earlier stage, or another configuration.

    Where kernels differ in size, the block common to both is copied. With another number of views, or without the
    amplifier, the input planes of that block have another meaning.
    """
    tensors, _ = weights.read(path, {"model": "ofanet"}, "python -m ofanet_init.train")
    own = network.state_dict()
    for key in own.keys() & tensors.keys():
        if own[key].ndim == tensors[key].ndim:
            block = tuple(slice(min(sizes)) for sizes in zip(own[key].shape, tensors[key].shape))
            own[key][block] = tensors[key][block]
