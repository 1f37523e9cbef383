"""Weights of the priors' networks: safetensors files with the architecture in their metadata."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import torch

from pnp_sci.errors import FormatError
from pnp_sci.formats import weights
from priors.networks.unet import Architecture, Network


def save(path: str | Path, name: str, architecture: Architecture, network: torch.nn.Module) -> str:
    """Write the weights of the prior `name` to `path` atomically; return the SHA-256 of their values."""
    return weights.save(path, network.state_dict(), {"prior": name, "architecture": json.dumps(asdict(architecture))})


def load(path: str | Path, name: str) -> tuple[Network, str]:
    """Read the network of the prior `name` from `path`, with the SHA-256 of its weights.

    Raises
    ------
    pnp_sci.errors.DataUnavailableError
        If the file does not exist.
    pnp_sci.errors.FormatError
        If it is not a safetensors file, belongs to another prior, or its values do not match their hash.
    """
    tensors, metadata = weights.read(path, {"prior": name}, f"python -m priors.train {name}")
    fields = weights.described(metadata, "architecture", tensors, path)
    try:
        architecture = Architecture(**{key: tuple(map(int, value)) for key, value in fields.items()})
    except (TypeError, ValueError) as error:
        raise FormatError(f"{path} has no valid architecture in its metadata: {error!r}") from error
    widths, blocks = architecture.widths, architecture.blocks
    if len(widths) != len(blocks) or not widths or sum(blocks) > len(tensors):
        raise FormatError(f"{path} has {len(tensors)} tensors, which its {architecture} does not")
    network = Network(architecture)
    weights.fill(network, tensors, path)
    return network.eval().to(memory_format=torch.channels_last), metadata["sha256"]  # type: ignore[call-overload]
