"""Packages that an extra installs: where one is missing, the error names the extra."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from pnp_sci.errors import MissingExtraError


@contextmanager
def needed_for(what: str, extra: str) -> Iterator[None]:
    """Imports inside are needed for `what`, and installed by an extra of this package.

    Raises
    ------
    MissingExtraError
        If a module that is imported inside is missing.

    Examples
    --------
    >>> with needed_for("it", "plot"):
    ...     import no_module
    Traceback (most recent call last):
    pnp_sci.errors.MissingExtraError: it needs no_module: python -m pip install ".[plot]" in the folder of the sources
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        package = str(missing.name).partition(".")[0]
        how = f'python -m pip install ".[{extra}]" in the folder of the sources'
        raise MissingExtraError(f"{what} needs {package}: {how}") from missing
