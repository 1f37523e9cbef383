"""Sizes that a file may declare: a few bytes can stand for more than the memory holds."""

from __future__ import annotations

import os

from pnp_sci.errors import FormatError

VARIABLE = "PNP_SCI_LARGEST"  # environment: bytes of the largest array that is read whatever the file's size
ALWAYS = 2**28  # bytes
PACKED = 100  # an array may be so many times as large as its file: random patterns compress by 8


def check_size(name: str, declared: float, stored: int) -> None:
    """Raise a FormatError if an array of `declared` bytes cannot well be in a file of `stored` bytes."""
    if declared > max(float(os.environ.get(VARIABLE, ALWAYS)), PACKED * stored):
        raise FormatError(
            f"{name} is declared with {declared:.3g} bytes, but the file has {stored:.3g}: if that is right, set the "
            f"environment variable {VARIABLE} to more"
        )
