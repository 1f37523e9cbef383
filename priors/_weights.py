"""Weights on disk: half-precision safetensors that carry their architecture and the hash of their values."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as serialise

from pnp_sci.errors import DataUnavailableError, FormatError

from ._network import Architecture, Network


def fingerprint(tensors: Mapping[str, torch.Tensor]) -> str:
    """SHA-256 of names, shapes and values, whatever the order of the tensors in the file."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {tuple(tensors[name].shape)}".encode())
        digest.update(tensors[name].contiguous().cpu().numpy().tobytes())
    return digest.hexdigest()


def save(path: str | Path, name: str, architecture: Architecture, network: torch.nn.Module) -> str:
    """Write the weights of the prior `name` to `path`, at once or not at all; return the hash of their values."""
    tensors = {key: value.detach().half().contiguous().cpu() for key, value in network.state_dict().items()}
    metadata = {
        "prior": name,
        "architecture": json.dumps(asdict(architecture)),
        "sha256": fingerprint(tensors),
    }
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(serialise(tensors, metadata))  # save_file would make it readable to its owner only
    os.replace(partial, path)
    return metadata["sha256"]


def load(path: str | Path, name: str) -> tuple[Network, str]:
    """Read the network of the prior `name` from `path`, and the hash of its weights.

    Raises
    ------
    pnp_sci.errors.DataUnavailableError
        If there is no such file.
    pnp_sci.errors.FormatError
        If the file is no safetensors file, holds another prior, or its values are not those that were saved.
    """
    path = Path(path)
    if not path.is_file():
        raise DataUnavailableError(f"weights: {path} does not exist; train it with 'python -m priors.train {name}'")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118, not a mapping
    except SafetensorError as error:
        raise FormatError(f"weights: {path} is not a safetensors file ({error})") from error
    if metadata.get("prior") != name:
        held = metadata.get("prior", "no prior of this package")
        raise FormatError(f"weights: {path} holds {held}, but {name} was expected")
    if metadata.get("sha256") != fingerprint(tensors):
        raise FormatError(f"weights: the values in {path} do not match their hash: the file is damaged")
    fields = json.loads(metadata["architecture"])
    network = Network(Architecture(**fields | {key: tuple(fields[key]) for key in ("widths", "blocks")}))
    try:
        network.load_state_dict({key: value.float() for key, value in tensors.items()}, strict=True)
    except RuntimeError as error:
        raise FormatError(f"weights: the tensors in {path} do not fit its architecture: {error}") from error
    return network.eval().to(memory_format=torch.channels_last), metadata["sha256"]  # type: ignore[call-overload]
