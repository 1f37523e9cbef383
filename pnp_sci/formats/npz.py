"""NPY and NPZ files; objects, which only pickle could read, are left out."""

from __future__ import annotations

import logging
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

import numpy as np

from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.limits import check_size

_log = logging.getLogger("pnp_sci")


def load_npy(path: Path) -> np.ndarray:
    """The array of an NPY file."""
    with path.open("rb") as file, _understood(path):
        return np.lib.format.read_array(file, allow_pickle=False)


def mapped(path: Path) -> np.memmap:
    """The array of an NPY file, of which only those parts are read that are looked at."""
    with _understood(path):
        return np.lib.format.open_memmap(path, mode="r")


@contextmanager
def _understood(path: Path) -> Iterator[None]:
    """Context in which what numpy says of a file becomes a FormatError: its advice is to unpickle."""
    try:
        yield
    except ValueError as error:
        raise FormatError(f"{path} cannot be read, it may be damaged or hold Python objects") from error


def load(path: Path) -> dict[str, np.ndarray]:
    """The arrays of an NPZ file."""
    if not zipfile.is_zipfile(path):
        raise FormatError(f"{path} is not an NPZ archive, or it is truncated")
    arrays = {}
    with zipfile.ZipFile(path) as archive:
        for member in archive.infolist():
            if not member.filename.endswith(".npy"):
                continue
            check_size(member.filename, member.file_size, path.stat().st_size)
            with archive.open(member) as file:
                if _is_object(file):
                    _log.info("%s: %s holds objects, and is left out", path, member.filename)
                    continue
            with archive.open(member) as file:
                arrays[member.filename.removesuffix(".npy")] = np.lib.format.read_array(file, allow_pickle=False)
    return arrays


def _is_object(file: IO[bytes]) -> bool:
    major, _ = np.lib.format.read_magic(file)
    header = np.lib.format.read_array_header_1_0 if major == 1 else np.lib.format.read_array_header_2_0
    return bool(header(file)[2].hasobject)


def save(path: Path, arrays: dict[str, np.ndarray], packed: bool = True) -> None:
    """Write an NPZ file, compressed if `packed`."""
    method = zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED
    with zipfile.ZipFile(path, "w", method) as archive:
        for key, array in arrays.items():
            if not key or "\0" in key:
                raise InputError(f"{key!r} cannot be the name of an array in NPZ")
            with archive.open(f"{key}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array(file, np.asanyarray(array), allow_pickle=False)
