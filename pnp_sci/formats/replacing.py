"""Atomic writing of files: whole, or not at all."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from uuid import uuid4

from pnp_sci.errors import FormatError, InputError, InputTypeError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Context with a temporary path that replaces `path` at the end, or is removed after an exception.

    A link stays, and what it points to is replaced. A device or a pipe is written to. Of folders only a result in
    Zarr is replaced: it stays under its name until the new one is complete.

    Raises
    ------
    FileNotFoundError
        If the parent folder does not exist.
    FileExistsError
        If `path` is a folder with files, or a file where a result in Zarr shall be.
    PermissionError
        If `path` is read-only.
    """
    place = _place(path)
    special = place.exists() and not place.is_file() and not place.is_dir()
    folder = Path(tempfile.gettempdir()) if special else place.parent
    temporary = folder / f".{uuid4().hex[:12]}{path.suffix}"
    try:
        yield temporary
        if special:
            with temporary.open("rb") as source, place.open("wb") as sink:
                shutil.copyfileobj(source, sink)
            temporary.unlink()
            return
        if place.is_file():
            shutil.copymode(place, temporary)
        if is_own_store(place):
            _swap(temporary, place)
        else:
            os.replace(temporary, place)
    except BaseException as error:
        if temporary.is_dir():
            shutil.rmtree(temporary, ignore_errors=True)
        else:
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.filename in (None, str(temporary)):
            raise type(error)(error.errno or errno.EIO, error.strerror or str(error), str(path)) from error
        if isinstance(error, (InputError, InputTypeError)) and str(temporary) in str(error):
            raise type(error)(str(error).replace(str(temporary), str(path))) from error
        raise


def is_own_store(place: Path) -> bool:
    """Whether a folder is a result that :func:`pnp_sci.formats.zarr.save` wrote."""
    if place.suffix.lower() != ".zarr":
        return False
    from pnp_sci.formats.zarr import texts_of  # loads numpy, which the help of commands does without

    try:
        texts_of(place)
    except FormatError:
        return False
    return True


def _swap(new: Path, place: Path) -> None:
    """Put a folder in the place of another, which is removed; it comes back after an error."""
    old = place.parent / f".{uuid4().hex[:12]}{place.suffix}"
    os.rename(place, old)
    try:
        os.rename(new, place)
    except BaseException:
        os.rename(old, place)
        raise
    shutil.rmtree(old, ignore_errors=True)


def _place(path: Path) -> Path:
    """Where the file behind `path` is or will be, links followed; an error if nothing can be written there."""
    if path.exists() and not path.is_file() and not path.is_dir():
        return path  # a device or a pipe
    place = Path(os.path.realpath(path))
    if not place.parent.is_dir():
        raise FileNotFoundError(f"{path}: there is no folder {(place if path.is_symlink() else path).parent}")
    if place.is_dir() and not is_own_store(place) and (path.suffix or any(place.iterdir())):
        raise FileExistsError(f"{path} is a folder{'' if path.suffix else ' that is not empty'}: remove it first")
    if place.is_file() and path.suffix.lower() == ".zarr":
        raise FileExistsError(f"{path} is a file, where a folder was expected: remove it first")
    if place.is_file() and not (place.stat().st_mode & 0o222 and os.access(place, os.W_OK)):
        raise PermissionError(errno.EACCES, "the file is read-only", str(path))
    return place


def check_writable(path: Path) -> None:
    """Raise the error that :func:`replacing` would raise, before any work; nothing is left."""
    place = _place(path)
    if place.exists() and not place.is_file() and not place.is_dir():
        if not os.access(place, os.W_OK):
            raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
        return
    trial = place.parent / f".{uuid4().hex[:12]}"
    try:
        trial.write_bytes(b"trial")
    except OSError as error:
        raise type(error)(
            error.errno, f"nothing can be written to the folder {place.parent}: {error.strerror}"
        ) from error
    finally:
        trial.unlink(missing_ok=True)


def same_file(first: Path, second: Path) -> bool:
    """Whether two paths are one file, by links or other names; neither need exist."""
    if first.exists() and second.exists():
        return first.is_file() and second.is_file() and os.path.samefile(first, second)
    return os.path.realpath(first) == os.path.realpath(second)
