"""What tells one run from another: all that determines its result, as JSON can hold it."""

from __future__ import annotations

import hashlib
import inspect
import math
import os
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._validate import real_array
from pnp_sci.api import solve
from pnp_sci.camera.calibration import Calibration
from pnp_sci.errors import InputError, InputTypeError
from pnp_sci.fleet.source import Source
from pnp_sci.formats.plain import as_json
from pnp_sci.pipeline.provenance import digest, versions
from pnp_sci.plugins.torch_module import is_torch_module
from pnp_sci.sensing.operator import SensingOperator

NO_MATTER = {"threads", "progress", "sequence", "prior_options"}  # of which the last two are recorded separately
PLAIN = bool, int, float, type(None)
ELSEWHERE = {  # options of solve that are not for many measurements: what serves instead
    "callback": "a callback cannot be sent to other processes",
    "reference": "compare with the truth afterwards, by pnp_sci.psnr",
    "peak": "it belongs to reference, which cannot be given",
    "mosaic": "its store has no colours; solve each measurement, or its planes, see pnp_sci.planes",
}


def settings_of(
    source: Source,
    masks: np.ndarray,
    sequence: int | None,
    options: dict[str, Any],
    calibration: Calibration | None = None,
) -> dict[str, Any]:
    """All that determines the result but the values of the measurements; the number of threads does not.

    Options that are not given count as their defaults, and masks of equal values are the same in any dtype.
    """
    used = "dark", "bad", "crop", "full_scale"
    raw = {f"calibration {name}": plain(name, getattr(calibration, name)) for name in used * (calibration is not None)}
    return raw | {
        "measurements": source.count,
        "size": list(masks.shape),
        "dtype": str(np.dtype(np.float64 if source.dtype == np.float64 else np.float32)),
        "masks": digest(masks.astype(np.float64)),
        "sequence": sequence,
        "options": {name: plain(name, value) for name, value in sorted(_whole(options).items())},
        "versions": dict(versions(find_spec("torch") is not None)),
    }


def with_defaults(options: dict[str, Any]) -> dict[str, Any]:
    """All arguments of solve but measurements and masks; options of the prior are one of them."""
    given = inspect.signature(solve).bind(None, None, **options)
    given.apply_defaults()
    return {name: value for name, value in given.arguments.items() if name not in ("y", "masks")}


def _whole(options: dict[str, Any]) -> dict[str, Any]:
    """The options that determine a result, those by default too."""
    given = with_defaults(options)
    return {name: value for name, value in given.items() if name not in NO_MATTER} | given["prior_options"]


def check_options(options: dict[str, Any]) -> None:
    """Raise an InputError for an option of solve that makes no sense for many measurements."""
    for name, instead in ELSEWHERE.items():
        if options.get(name) is not None:
            raise InputError(f"{name} was given, which reconstruct does not take: {instead}")


def plain(name: str, value: Any) -> Any:
    """A value as JSON can hold it, the same in each process: arrays, files and weights by their SHA-256.

    >>> plain("prior", ("tv", 3))
    ['tv', 3]
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, PLAIN):
        return value
    if isinstance(value, (str, Path)):
        return f"{value}, SHA-256 {_of_file(Path(value))}" if os.path.isfile(value) else str(value)
    if isinstance(value, (list, tuple)):
        return [plain(name, item) for item in value]
    if isinstance(value, dict):
        return {str(key): plain(name, item) for key, item in value.items()}
    if isinstance(value, SensingOperator):
        value = value.masks
    if hasattr(value, "__array__") and hasattr(value, "shape"):
        array = real_array(name, value)
        return [str(array.dtype), list(array.shape), digest(array)]
    if is_torch_module(value):
        return [_named(type(value)), _of_module(value)]
    if is_dataclass(value) and not isinstance(value, type):
        return [_named(type(value)), plain(name, {field.name: getattr(value, field.name) for field in fields(value)})]
    if hasattr(value, "__qualname__") and _says_all(value):
        return _named(value)
    raise InputTypeError(
        f"{name} is {value!r}: a name, a number, an array, a torch module, or a function that its name alone describes "
        "was expected; give a dataclass instead"
    )


def _named(thing: Any) -> str:
    return f"{thing.__module__}.{thing.__qualname__}"


def _says_all(thing: Any) -> bool:
    """Whether the name of a function says what it does: it is no lambda, and bound to no values."""
    return "<" not in thing.__qualname__ and not getattr(thing, "__closure__", None) and not inspect.ismethod(thing)


def _of_file(path: Path) -> str:
    whole = hashlib.sha256()
    with path.open("rb") as file:
        while part := file.read(2**20):
            whole.update(part)
    return whole.hexdigest()


def _of_module(module: Any) -> str:
    """SHA-256 of a torch module: its structure, weights, and all attributes of its parts that JSON can hold."""
    said: list[Any] = [repr(module)]
    for key, tensor in (*module.named_parameters(), *module.named_buffers()):
        said.append([key, str(tensor.dtype), digest(tensor.detach().cpu().double().numpy())])
    for key, part in module.named_modules():
        for attribute, value in vars(part).items():
            if not attribute.startswith("_"):
                with suppress(TypeError, ValueError):
                    said.append([key, attribute, as_json(value)])
    return hashlib.sha256(as_json(said).encode()).hexdigest()
