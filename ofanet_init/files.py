"""Weights of the decoders: safetensors files with the name of the model and its configuration in their metadata."""

from __future__ import annotations

import json
import re
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ofanet_init.baselines.admm_net import ADMMNet
from ofanet_init.baselines.birnat import BIRNAT
from ofanet_init.baselines.config import BaselineConfig
from ofanet_init.baselines.unet import UNet
from ofanet_init.config import OFaNetConfig
from ofanet_init.network import OFaNet
from pnp_sci.errors import FormatError
from pnp_sci.formats import weights

FOLDER = Path(__file__).with_name("weights")
MODELS: dict[str, tuple[Any, Any]] = {  # name -> network, its configuration
    OFaNet.model: (OFaNet, OFaNetConfig),
    **{network.model: (network, BaselineConfig) for network in (UNet, ADMMNet, BIRNAT)},
}


def place(model: str, views: int, frames: int) -> Path:
    """Where the weights of a network for V and B are."""
    return FOLDER / f"{_prefix(model)}v{views}b{frames}.safetensors"


def sizes(model: str) -> list[tuple[int, int]]:
    """Views and frames of the networks `model` that have weights, in order."""
    names = (re.fullmatch(rf"{_prefix(model)}v(\d+)b(\d+)", file.stem) for file in FOLDER.glob("*.safetensors"))
    return sorted((int(name[1]), int(name[2])) for name in names if name)


def _prefix(model: str) -> str:
    return "" if model == OFaNet.model else f"{model}-"


def save(path: str | Path, network: Any) -> str:
    """Write the weights of `network` to `path` atomically; return the SHA-256 of their values."""
    metadata = {"model": network.model, "config": json.dumps(asdict(network.config))}
    return weights.save(path, network.state_dict(), metadata)


def load(path: str | Path, model: str = OFaNet.model) -> tuple[Any, str]:
    """Read a network from `path`, with the SHA-256 of its weights; raises as :func:`pnp_sci.formats.weights.read`."""
    tensors, metadata = weights.read(path, {"model": model}, _command(model))
    fields = weights.described(metadata, "config", tensors, path)
    make, configure = MODELS[model]
    try:
        network = make(configure(**fields))
    except (TypeError, ValueError) as error:
        raise FormatError(f"{path} has no valid configuration in its metadata: {error!r}") from error
    weights.fill(network, tensors, path)
    return network.eval(), metadata["sha256"]


def start(network: Any, path: str | Path) -> None:
    """Initialise `network` with the weights in `path` whose names it has: an earlier stage, or another configuration.

    Where kernels differ in size, the block common to both is copied. With another number of views, or without the
    amplifier, the input planes of that block have another meaning.
    """
    tensors, _ = weights.read(path, {"model": network.model}, _command(network.model))
    own = network.state_dict()
    for key in own.keys() & tensors.keys():
        if own[key].ndim == tensors[key].ndim:
            block = tuple(slice(min(sizes)) for sizes in zip(own[key].shape, tensors[key].shape))
            own[key][block] = tensors[key][block]


def _command(model: str) -> str:
    return f"python -m ofanet_init.train --model {model}"
