"""Argument validation."""

from __future__ import annotations

import math
from collections.abc import Iterable
from numbers import Integral, Real
from os import PathLike
from typing import Any

import numpy as np

from pnp_sci.errors import InputError, InputTypeError

LONGEST = 100  # characters of a value in a message
FEW = 10  # values of an array in a message


def shown(value: Any) -> str:
    """What came, for a message: a short value as it is, of an array its shape and type, of others the beginning.

    >>> shown("tv"), shown(np.zeros((2, 10, 64, 64)))
    ("'tv'", 'an array (2, 10, 64, 64) of float64')
    """
    shape = getattr(value, "shape", None)
    if isinstance(shape, tuple) and hasattr(value, "__array__") and math.prod(shape) > FEW:
        return f"an array {tuple(shape)} of {value.dtype}"
    text = repr(value)
    return text if len(text) <= LONGEST else f"{text[:LONGEST]}..."


def real_array(name: str, value: Any) -> np.ndarray:
    """`value` as an array of real numbers; raises an InputTypeError that names it, also for masked values."""
    if np.ma.is_masked(value):
        raise InputTypeError(
            f"{name} is a masked array with {np.ma.count_masked(value)} masked values: an array was expected"
        )
    try:
        array = np.asarray(value)
    except Exception as error:  # rows of different lengths, and what each library says of its own arrays
        raise InputTypeError(f"{name} is no array of numbers: {error}") from error
    if array.dtype.kind not in "biuf" and array.ndim == 0:  # no array at all
        hint = "; read_measurement, read_masks and read_video of pnp_sci.io read files"
        told = hint if isinstance(value, (str, PathLike)) else ""
        raise InputTypeError(f"{name} is {shown(value)}: an array of real numbers was expected{told}")
    if array.dtype.kind not in "biuf":
        raise InputTypeError(f"{name} has dtype {array.dtype}: real numbers were expected")
    return array


def shaped(name: str, value: Any, shape: tuple[int, ...], dtype: np.dtype) -> np.ndarray:
    """`value` as a C-ordered array of this shape and dtype; what is too large for the dtype becomes infinite."""
    array = real_array(name, value)
    if array.shape != shape:
        raise InputError(f"{name} has shape {array.shape}: {shape} was expected, as the masks have it")
    with np.errstate(over="ignore"):
        return np.ascontiguousarray(array, dtype)


SCALES = (255.0, 1023.0, 4095.0, 16383.0, 65535.0)  # white of 8, 10, 12, 14 and 16 bits


def white(name: str, dtype: np.dtype, largest: float) -> float:
    """The value of white in pictures of this dtype: 255 of uint8, 1 of bool, and of floats below 2.

    Of uint16, which also holds 10, 12 and 14 bits, and of other floats it is white of the fewest bits that hold the
    `largest` value.
    """
    if dtype.kind in "fb" and largest < 2:  # a float above 1 is too bright, rather than a grey level of 8 bits
        return 1.0
    if dtype.kind not in "fb" and dtype.newbyteorder("=") not in (np.uint8, np.uint16):  # 255 in int64 would be black
        raise InputTypeError(f"{name} has dtype {dtype}: floats in [0, 1], uint8 or uint16 were expected")
    return next((scale for scale in SCALES if scale >= largest), largest)


def require_finite(name: str, array: np.ndarray, hint: str = "") -> None:
    """Raise an InputError that says how many values of `array` are NaN or infinite, where the first is, and a hint."""
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        bad = ~np.isfinite(array)
        first = tuple(int(i) for i in np.unravel_index(int(np.argmax(bad)), array.shape))
        raise InputError(
            f"{name} has {int(bad.sum())} values that are NaN or infinite in {array.dtype}, the first at index "
            f"{first}: finite values were expected{hint}"
        )


def finite_number(name: str, value: Any, expected: str = "a finite number >= 0") -> float:
    """`value` as a float, finite and >= 0."""
    try:
        converted = float(value) if isinstance(value, Real) else math.nan
    except OverflowError:  # an int that no float can hold
        converted = math.inf
    if not 0 <= converted < math.inf:
        raise InputError(f"{name} is {shown(value)}: {expected} was expected")
    return converted


def positive_number(name: str, value: Any) -> float:
    """`value` as a float, finite and > 0."""
    expected = "a finite number > 0"
    if (number := finite_number(name, value, expected)) == 0:
        raise InputError(f"{name} is {shown(value)}: {expected} was expected")
    return number


def true_or_false(name: str, value: Any) -> None:
    """Raise an InputError if `value` is not a bool, of Python or of numpy: a text such as "no" would count as true."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError(f"{name} is {shown(value)}: True or False was expected")


def whole(name: str, value: Any, least: int, most: float = math.inf) -> int:
    """`value` as an int."""
    if not isinstance(value, Integral) or value < least or int(value) > most:
        expected = f">= {least}" if most == math.inf else f"from {least} to {most}"
        raise InputError(f"{name} is {shown(value)}: a whole number {expected} was expected")
    return int(value)


def elements(value: Any) -> tuple | None:
    """What `value` holds; None if it cannot be iterated over, as an array without dimensions."""
    try:
        return tuple(value)
    except TypeError:
        return None


def one_of(name: str, value: Any, names: Iterable[str], or_else: str = "") -> None:
    """Raise an InputError that lists the names there are, if `value` is none of them."""
    if not isinstance(value, str) or value not in names:
        raise InputError(f"{name} is {shown(value)}: one of these was expected: {', '.join(names)}{or_else}")


def instance(name: str, value: Any, *kinds: type) -> None:
    """Raise an InputTypeError if `value` is neither None nor of one of these types."""
    if value is not None:
        needed(name, value, *kinds)


def needed(name: str, value: Any, *kinds: type) -> None:
    """Raise an InputTypeError if `value` is not of one of these types."""
    if not isinstance(value, kinds):
        raise InputTypeError(f"{name} is {shown(value)}: {' or '.join(kind.__name__ for kind in kinds)} was expected")
