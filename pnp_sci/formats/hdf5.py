"""HDF5 files as arrays, by the names ``group/array``. Texts and other objects are left out, without being read."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from pnp_sci._optional import needed_for
from pnp_sci.errors import FormatError, InputError
from pnp_sci.formats.child import apart
from pnp_sci.formats.limits import check_size

SIGNATURE = b"\x89HDF\r\n\x1a\n"
HIDDEN = "#"  # begins the names of MATLAB's own groups


def is_hdf5(content: bytes) -> bool:
    """Whether a file has HDF5's signature, at its beginning or after a header of 512, 1024 or 2048 bytes."""
    return any(content.startswith(SIGNATURE, offset) for offset in (0, 512, 1024, 2048))


def load(path: Path, matlab: bool = False) -> dict[str, np.ndarray]:
    """All numeric arrays, axes as HDF5 has them; of MATLAB's files structs are ``struct.field``."""
    h5py()  # loaded once, not by each child
    return apart(lambda: _read(path, matlab), path.stat().st_size)


def h5py() -> Any:
    """The package, or an error that names the extra."""
    with needed_for("HDF5, which is also the format of MAT-files v7.3,", "hdf5"):
        import h5py
    return h5py


def opened(path: Path) -> Any:
    """A file to be read; a FormatError if another program writes to it."""
    try:
        return h5py().File(path, "r")
    except BlockingIOError:
        raise FormatError(f"{path}: another program has it open for writing: close it there first") from None


def _read(path: Path, matlab: bool) -> dict[str, np.ndarray]:
    with opened(path) as file:
        return {
            name: array for name, item in _datasets(file, "", matlab) for array in _arrays(path, name, item, matlab)
        }


def _datasets(group: Any, prefix: str, matlab: bool, above: tuple[Any, ...] = ()) -> Iterator[tuple[str, Any]]:
    """All datasets below a group, links followed, by their names."""
    library = h5py()
    here = library.h5o.get_info(group.id).addr, group.file.filename
    if here in above:  # a link to a group that holds it
        return
    for key in group:  # bytes, where a name is not UTF-8
        if matlab and str(key).startswith(HIDDEN):
            continue
        try:
            item = group[key]
        except KeyError:
            if isinstance(link := group.get(key, getlink=True), library.ExternalLink):
                raise FormatError(f"{prefix}{key} is in another file, {link.filename}, which is not there") from None
            continue  # a soft link to nothing
        if isinstance(item, library.Dataset):
            yield f"{prefix}{key}", item
        elif isinstance(item, library.Group):
            yield from _datasets(item, f"{prefix}{key}{'.' if matlab else '/'}", matlab, (*above, here))


def _arrays(path: Path, name: str, item: Any, matlab: bool) -> Iterator[np.ndarray]:
    """The dataset as an array, if it is one of numbers."""
    if matlab and item.attrs.get("MATLAB_class") == b"cell":
        parts = [a for ref in item[()].ravel() for a in _arrays(path, name, item.file[ref], matlab)]
        if len({(a.shape, a.dtype) for a in parts}) == 1:
            yield np.stack(parts) if len(parts) > 1 else parts[0]
        return
    if item.dtype.names == ("real", "imag"):
        whole = item[()]
        yield whole["real"] + 1j * whole["imag"]
    elif item.dtype.kind in "biufc" and item.shape is not None and not item.attrs.get("MATLAB_empty"):
        _check_storage(path, name, item)
        array = np.asarray(item[()])
        yield array.astype(bool) if matlab and item.attrs.get("MATLAB_class") == b"logical" else array


def _check_storage(path: Path, name: str, item: Any) -> None:
    """Raise an error if a file that the dataset refers to is not there, or its size cannot be."""
    stored = path.stat().st_size + sum(other.stat().st_size for other in others_of(name, item))
    check_size(name, item.size * item.dtype.itemsize, stored)


def others_of(name: str, item: Any) -> list[Path]:
    """The other files with values of a dataset; a FormatError if one is not there: HDF5 would read 0."""
    others = [name for name, _, _ in item.external or ()]
    if item.is_virtual:
        others += [source.file_name for source in item.virtual_sources() if source.file_name != "."]
    places = [Path(item.file.filename).parent / other for other in others]
    if missing := [place for place in places if not place.is_file()]:
        raise FormatError(f"{name} is in another file, {missing[0].name}, which is not there")
    return places


def save(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write the arrays, gzip'ed."""
    for key in arrays:
        if "\0" in key or any(part in ("", ".") for part in key.split("/")):
            raise InputError(f"{key!r} cannot be the name of an array in HDF5")
    with creating(path) as file:
        for key, a in arrays.items():
            file.create_dataset(key, data=a, compression="gzip" if a.size > 1 else None)


@contextmanager
def creating(path: Path) -> Iterator[Any]:
    """Context with a new file, which is made in memory and written at the end: HDF5 crashes on a full disk."""
    content = BytesIO()
    with h5py().File(content, "w") as file:
        yield file
    path.write_bytes(content.getbuffer())
