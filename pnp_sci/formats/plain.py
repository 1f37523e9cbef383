"""Values as JSON can hold them, and as texts that are not too long."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import InputTypeError


def some(texts: Sequence[str], most: int) -> str:
    """The first of several texts, `most` at most.

    >>> some(["a", "b", "c", "d"], 2)
    'a, b and 2 more'
    """
    return ", ".join(texts[:most]) + (f" and {len(texts) - most} more" if len(texts) > most else "")


def finite(value: Any) -> Any:
    """Replace numbers that are not finite, which JSON does not have, by None.

    >>> finite({"psnr": [1.0, float("inf")]})
    {'psnr': [1.0, None]}
    """
    if isinstance(value, dict):
        return {key: finite(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_json(value: Any, indent: int | None = None) -> str:
    """Settings or scenes as text.

    Raises
    ------
    InputTypeError
        If they hold what JSON does not have.

    Examples
    --------
    >>> as_json({"weights": Path("net.safetensors"), "sigma": np.float32(0.5)})
    '{"weights": "net.safetensors", "sigma": 0.5}'
    """
    return json.dumps(value, default=_plain, indent=indent)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in "biufU":
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise InputTypeError(f"settings or scenes hold {value!r} of type {type(value).__name__}: JSON has no such thing")
