"""Validation of the tags of a MAT-file (v5) before SciPy reads it, because unknown types crash SciPy.

Format: MathWorks, "MAT-File Format". An element is a tag (type, size) and its data, padded to 8 bytes.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator

NUMBERS = {1, 2, 3, 4, 5, 6, 7, 9, 12, 13, 16, 17, 18}  # types of data: integers, floats, characters
MATRIX, COMPRESSED, FLAGS = 14, 15, 6
OF_NUMBERS = range(4, 16)  # classes of arrays without nested arrays: char, sparse, double to uint64
SPARSE = 5  # class with three parts of data: row indices, column starts, values
COMPLEX = 0x800  # flag of an additional part
HEADER = 128  # bytes of the file header


def check(content: bytes) -> None:
    """Raise a ValueError if the file `content` has an element that could crash SciPy; v4 files have no tags."""
    if 0 in content[:4] or len(content) < HEADER:
        return
    order = "<" if content[126:128] == b"IM" else ">"
    for kind, data in _elements(content[HEADER:], order):
        inside = _elements(zlib.decompress(data), order) if kind == COMPRESSED else [(kind, data)]
        for inner, matrix in inside:
            if inner != MATRIX:
                raise ValueError(f"an element has type {inner}: an array was expected")
            _check_matrix(matrix, order)


def _check_matrix(content: bytes, order: str) -> None:
    parts = list(_elements(content, order))
    if len(parts) < 3 or parts[0][0] != FLAGS or len(parts[0][1]) != 8:  # flags, shape, name
        raise ValueError("an array does not begin with its flags, shape and name")
    flags = struct.unpack_from(order + "I", parts[0][1])[0]
    array = flags & 0xFF
    of_numbers = array in OF_NUMBERS
    if of_numbers and len(parts) != 3 + (3 if array == SPARSE else 1) + bool(flags & COMPLEX):
        raise ValueError(f"an array of class {array} has {len(parts)} parts")
    if array <= OF_NUMBERS[-1] and array != SPARSE:
        shape = struct.unpack(f"{order}{len(parts[1][1]) // 4}i", parts[1][1])
        if math.prod(shape) > len(content):  # SciPy would allocate all of them
            raise ValueError(f"an array of {len(content)} bytes has shape {shape}")
    for kind, data in parts[1:]:
        if kind not in NUMBERS and (of_numbers or kind != MATRIX):
            raise ValueError(f"part of an array has type {kind}: one of {sorted(NUMBERS)} was expected")
        if kind == MATRIX and data:
            _check_matrix(data, order)


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Yield type and data of each element."""
    at = 0
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order + "II", content, at)
        start = at + 8
        if kind >> 16:  # small element: up to 4 bytes within the tag
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
        end = start + size
        if end > len(content) or (start == at + 4 and size > 4):
            raise ValueError(f"an element of {size} bytes extends beyond its array or the file")
        yield kind, content[start:end]
        at = end if kind == COMPRESSED else at + 8 if start == at + 4 else end + -size % 8
