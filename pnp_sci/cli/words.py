"""Messages that name arguments of Python, as the command line says them."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from contextlib import contextmanager

OPTIONS = {  # what messages say of arguments, and of options in its place
    r"pnp_sci\.register\(y, masks\) estimates it, ": "",
    r"solve\(\.\.\., (\w+)=True\)": r"--\1",
    r"noise=pnp_sci\.Sensor\(full_scale=([^,)]+)\)": r"--full-scale \1",
    r"the masks by key=": "the masks by --masks-key",
    r"the video by key=": "the video by --reference-key",
    r'\b(bad|mosaic)="(\w+)"': r"--\1 \2",
    r"\b(bad|key|mosaic|peak)=": r"--\1",
    r"\b(register|uncertainty)=True": r"--\1",
}


def as_options(text: str) -> str:
    """A message with the options of ``pnp-sci`` in place of the arguments.

    >>> as_options('bad="auto" leaves them out; solve(..., register=True) corrects it; peak= says what is white')
    '--bad auto leaves them out; --register corrects it; --peak says what is white'
    """
    for argument, option in OPTIONS.items():
        text = re.sub(argument, option, text)
    return text


def _in_words(record: logging.LogRecord) -> bool:
    record.msg, record.args = as_options(record.getMessage()), ()
    return True


@contextmanager
def logged_as_options() -> Iterator[None]:
    """Context in which the log of the package names options."""
    log = logging.getLogger("pnp_sci")
    log.addFilter(_in_words)
    try:
        yield
    finally:
        log.removeFilter(_in_words)
