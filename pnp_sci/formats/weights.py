"""Weights of networks on disk: half-precision safetensors with metadata and the hash of their values.

This module imports torch; :mod:`pnp_sci` imports it on first use only.
"""

from __future__ import annotations

import hashlib
import json
import reprlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save as serialise

from pnp_sci.errors import DataUnavailableError, FormatError
from pnp_sci.formats.replacing import replacing


def fingerprint(tensors: Mapping[str, torch.Tensor]) -> str:
    """SHA-256 of names, shapes and values, independent of the order of the tensors."""
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {tuple(tensors[name].shape)}".encode())
        digest.update(tensors[name].contiguous().cpu().numpy().tobytes())
    return digest.hexdigest()


def save(path: str | Path, tensors: Mapping[str, torch.Tensor], metadata: Mapping[str, str]) -> str:
    """Write `tensors` as float16 and `metadata` to `path` atomically; return the SHA-256 of the values."""
    halves = {key: value.detach().half().contiguous().cpu() for key, value in tensors.items()}
    digest = fingerprint(halves)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:  # save_file removes others' read permission
        temporary.write_bytes(serialise(halves, {**metadata, "sha256": digest}))
    return digest


def read(path: str | Path, expected: Mapping[str, str], remedy: str) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    """Read tensors (float32) and metadata from `path`.

    Parameters
    ----------
    path : str or Path
    expected : mapping
        Required metadata, such as ``{"prior": "video"}``.
    remedy : str
        Command that makes the file, for the error message.

    Raises
    ------
    DataUnavailableError
        If the file does not exist.
    FormatError
        If it is not a safetensors file, has other metadata, or its values do not match their hash.
    """
    path = Path(path)
    if not path.is_file():
        raise DataUnavailableError(f"weights: {path} does not exist; train it with '{remedy}'")
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118, not a mapping
    except SafetensorError as error:
        raise FormatError(f"weights: {path} is not a safetensors file ({error})") from error
    for key, value in expected.items():
        if metadata.get(key) != value:
            held = metadata.get(key, f"no {key} of this package")
            raise FormatError(f"weights: {path} holds {held}, but {value} was expected")
    kinds = sorted({str(value.dtype) for value in tensors.values()})
    if not {*kinds} <= {"torch.float16", "torch.float32"}:
        raise FormatError(f"weights: {path} has {', '.join(kinds)}: float16 was expected")
    if metadata.get("sha256") != fingerprint(tensors):
        raise FormatError(f"weights: the values in {path} do not match their hash: the file is damaged")
    return {key: value.float() for key, value in tensors.items()}, metadata


def described(
    metadata: Mapping[str, str], key: str, tensors: Mapping[str, torch.Tensor], path: str | Path
) -> dict[str, Any]:
    """The fields of an architecture, JSON in the metadata: text, booleans, whole numbers and lists of such numbers.

    Raises
    ------
    FormatError
        If there are none, or a number is not from 1 to the number of tensors or the largest of their dimensions: a
        network of such a size has other tensors, and may take hours to be made.
    """
    try:
        fields = dict(json.loads(metadata[key]).items())
    except (KeyError, AttributeError, ValueError, RecursionError) as error:
        raise FormatError(f"weights: {path} has no valid {key} in its metadata: {error!r}") from error
    most = max([len(tensors), *(size for tensor in tensors.values() for size in tensor.shape)])
    for name, value in fields.items():
        numbers = value if isinstance(value, list) else [value]
        if not numbers or not all(isinstance(n, (str, bool)) or (type(n) is int and 1 <= n <= most) for n in numbers):
            shown = reprlib.repr(value)
            raise FormatError(f"weights: {name} of {path} is {shown}: whole numbers from 1 to {most} were expected")
    return fields


def fill(network: torch.nn.Module, tensors: Mapping[str, torch.Tensor], path: str | Path) -> None:
    """Load `tensors` into `network`; raises a FormatError that names `path` if their names or shapes differ."""
    try:
        network.load_state_dict(dict(tensors), strict=True)
    except RuntimeError as error:
        raise FormatError(f"weights: the tensors in {path} do not fit its architecture: {error}") from error
