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
    >>> with needed_for("result.plot()", "plot"):
    ...     import no_such_module
    Traceback (most recent call last):
    pnp_sci.errors.MissingExtraError: result.plot() needs no_such_module: python -m pip install "pnp-sci[plot]"
    """
    try:
        yield
    except ModuleNotFoundError as missing:
        package = str(missing.name).partition(".")[0]
        raise MissingExtraError(f'{what} needs {package}: python -m pip install "pnp-sci[{extra}]"') from missing
