"""MAT-files as arrays. In MATLAB planes come last, (H, W, K) and (H, W, B, V); readers and writers transpose them.

A field of a struct is ``struct.field``; a cell of arrays of one shape is their stack.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci.errors import FormatError, InputError, InputTypeError
from pnp_sci.formats import hdf5
from pnp_sci.formats.child import apart
from pnp_sci.formats.limits import check_size

PLANES_FIRST = {"pic"}  # names of arrays with planes first, as in BIRNAT's published results
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,30}")  # of a variable
HEADER, MATRIX, COMPRESSED = 128, 14, 15  # bytes of the file's header; types of elements (MathWorks, "MAT-File Format")
LARGEST = 2**31  # bytes of an array in MAT v5
OCTAVE = b"# Created by Octave"


def load(path: Path) -> dict[str, np.ndarray]:
    """All numeric arrays, planes first."""
    content = path.read_bytes()
    if content.startswith(OCTAVE):
        raise FormatError(f"{path} is a text file of Octave: save it with `save -v7`")
    if hdf5.is_hdf5(content):
        if not content.startswith(b"MATLAB"):  # HDF5 of other software under this name
            return hdf5.load(path)
        arrays = {key: a.T for key, a in hdf5.load(path, matlab=True).items()}  # h5py sees the axes reversed
    else:
        import scipy.io  # noqa: F401, here once, not in each child

        _check_sizes(content)
        arrays = apart(lambda: _read(path), len(content))
    return {key: a if key in PLANES_FIRST else _planes_first(a) for key, a in arrays.items()}


def _read(path: Path) -> dict[str, np.ndarray]:
    import scipy.io

    logical = {key for key, _, kind in scipy.io.whosmat(path) if kind == "logical"}
    found = {key: a for key, a in scipy.io.loadmat(path).items() if not key.startswith("__")}
    arrays = dict(part for key, a in found.items() for part in _parts(key, a))
    return {key: a.astype(bool) if key in logical else a for key, a in arrays.items()}


def _parts(name: str, value: Any) -> Iterator[tuple[str, np.ndarray]]:
    """The numeric arrays in a value of SciPy's: itself, or those in a struct or a cell."""
    if hasattr(value, "toarray"):
        value = value.toarray()  # sparse
    if not isinstance(value, np.ndarray):
        return
    if value.dtype.names:
        for n, record in enumerate(value.ravel()):
            for field in value.dtype.names:
                yield from _parts(f"{name}.{field}" if value.size == 1 else f"{name}[{n}].{field}", record[field])
    elif value.dtype == object:
        items = value.ravel().tolist()
        numeric = [a for a in items if isinstance(a, np.ndarray) and a.dtype.kind in "biufc"]
        if len(items) == len(numeric) and len({(a.shape, a.dtype.str) for a in numeric}) == 1:
            yield from _parts(name, np.stack(items, -1) if len(items) > 1 else items[0])
        else:
            for n, item in enumerate(items):
                yield from _parts(f"{name}[{n}]", item)
    elif value.dtype.kind in "biufc":
        yield name, value


def _check_sizes(content: bytes) -> None:
    """Raise an error if an array is declared larger than the file can hold (v5; files of v4 are not compressed)."""
    if 0 in content[:4] or len(content) < HEADER:
        return
    order = "<" if content[126:128] == b"IM" else ">"
    at = HEADER
    while at + 8 <= len(content):
        kind, size = struct.unpack_from(order + "II", content, at)
        start = content[at + 8 : at + 8 + min(size, 4096)]
        packed = kind == COMPRESSED
        if packed:
            start = zlib.decompressobj().decompress(start, 64)
        if len(start) < 8 or at + 8 + size > len(content):
            raise FormatError(f"an element of {size} bytes extends beyond the file")
        inner, declared = struct.unpack_from(order + "II", start) if packed else (kind, size)
        if inner != MATRIX:
            raise FormatError(f"an element has type {inner}: an array was expected")
        check_size("an array", declared, len(content))
        at += 8 + size + (0 if packed else -size % 8)


def _planes_first(array: np.ndarray) -> np.ndarray:
    """Transpose (H, W, K) to (K, H, W), or (H, W, B, V) to (V, B, H, W)."""
    return array.transpose(*range(array.ndim - 1, 1, -1), 0, 1) if array.ndim > 2 else array


def load_texts(path: Path) -> dict[str, str]:
    """The variables of a MAT-file v5 that are a line of text."""
    import scipy.io  # noqa: F401, here once, not in each child

    _check_sizes(path.read_bytes())
    found = apart(lambda: _texts(path), path.stat().st_size)
    return {key: text.tobytes().decode() for key, text in found.items()}


def _texts(path: Path) -> dict[str, np.ndarray]:
    import scipy.io

    names = [key for key, _, kind in scipy.io.whosmat(path) if kind == "char"]
    found = scipy.io.loadmat(path, variable_names=names)
    return {key: np.frombuffer("".join(found[key].ravel()).encode(), np.uint8) for key in names}


def save(path: Path, arrays: dict[str, np.ndarray], texts: Mapping[str, str] | None = None) -> None:
    """Write MAT v5: arrays, and lines of text."""
    import scipy.io

    for key, a in arrays.items():
        if not NAME.fullmatch(key):
            raise InputError(f"{key!r}: a name in a MAT-file is a letter and up to 30 letters, digits and underscores")
        if a.ndim < 2 or a.dtype in (np.float16, np.longdouble):
            raise InputTypeError(f"{key} is {a.dtype} {a.shape}: MAT-files have no 1-D, float16 or longdouble arrays")
        if a.nbytes >= LARGEST:
            raise InputError(f"{key} has {a.nbytes} bytes: MAT-files hold less than {LARGEST} an array; use HDF5")
    last = {key: a.transpose(-2, -1, *range(a.ndim - 3, -1, -1)) for key, a in arrays.items()}
    scipy.io.savemat(path, last | dict(texts or {}), do_compression=True)
