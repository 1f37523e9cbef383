"""What numpy arrays and tensors of torch have in common, so that one formula serves both."""

from __future__ import annotations

import math
import sys
from typing import Any

import numpy as np

from pnp_sci._validate import shaped
from pnp_sci.errors import InputError


def library(array: Any) -> Any:
    """numpy for an array of numpy, torch for a tensor; torch is not imported."""
    return np if isinstance(array, np.ndarray) else sys.modules["torch"]


def copied(array: Any) -> Any:
    """A copy of an array or tensor."""
    return array.copy() if isinstance(array, np.ndarray) else array.clone()


def single(array: Any) -> Any:
    """An array or tensor in float32, C-ordered; itself if it is."""
    return np.ascontiguousarray(array, np.float32) if isinstance(array, np.ndarray) else array.float().contiguous()


def dot(a: Any, b: Any) -> float:
    """Inner product of two pictures (..., H, W); einsum starts no threads."""
    return library(a).einsum("i,i", a.reshape(-1), b.reshape(-1)).item()


def length(picture: Any) -> float:
    """Euclidean norm of (H, W)."""
    return math.sqrt(dot(picture, picture))


def all_finite(array: Any) -> bool:
    """Whether no value is NaN or infinite."""
    return bool(library(array).isfinite(array).all())


def like(name: str, value: Any, array: Any) -> Any:
    """`value`, which must have the shape of `array` and be of its library; errors name it."""
    if isinstance(array, np.ndarray):
        return shaped(name, value, array.shape, array.dtype)
    came = tuple(value.shape) if isinstance(value, type(array)) else type(value).__name__
    if came != tuple(array.shape):
        raise InputError(f"{name} is {came}: a tensor {tuple(array.shape)} was expected")
    return value.to(array)
