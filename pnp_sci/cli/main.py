"""The command ``pnp-sci``: its commands are imported on use, and what is heavy by the command that needs it."""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import import_module
from io import TextIOWrapper
from typing import Any, NoReturn

import click

from pnp_sci.errors import UnknownPluginError

COMMANDS = {
    "bench": "pnp_sci.cli.bench:bench",
    "calibrate": "pnp_sci.cli.calibrate:calibrate",
    "compare": "pnp_sci.cli.compare:compare",
    "demo": "pnp_sci.cli.demo:demo",
    "info": "pnp_sci.cli.info:info",
    "priors": "pnp_sci.cli.info:priors",
    "recommend": "pnp_sci.cli.info:recommend",
    "reconstruct": "pnp_sci.cli.reconstruct:reconstruct",
    "simulate": "pnp_sci.cli.simulate:simulate",
    "solve": "pnp_sci.cli.solve:solve",
}


ENDED = 128 + signal.SIGTERM  # exit code of a process that SIGTERM ends, as shells give it


class _OnUse(Mapping[str, click.Command]):
    """Commands by name, each imported when it is asked for."""

    def __getitem__(self, name: str) -> click.Command:
        module, attribute = COMMANDS[name].split(":")
        return getattr(import_module(module), attribute)

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(click.Group):
    """Failures are one line on stderr and exit code 1 (2: the command line is at fault); --debug shows them whole."""

    def invoke(self, ctx: click.Context) -> Any:
        with _sigterm_as_exception():
            return super().invoke(ctx) if ctx.params["debug"] else self._invoke_in_a_line(ctx)

    def _invoke_in_a_line(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except UnknownPluginError as error:
            raise click.UsageError(str(error)) from error
        except Exception as error:
            if isinstance(error, BrokenPipeError) and error.filename is None:
                raise  # nobody reads stdout any more, as after `| head -1`: click ends without a word
            text = " ".join(str(error).split())
            known = isinstance(error, (ValueError, TypeError, OSError, RuntimeError, ImportError)) and text
            raise click.ClickException(text if known else f"{type(error).__name__}: {text}") from error


@contextmanager
def _sigterm_as_exception() -> Iterator[None]:
    """Context in which SIGTERM, by which batch systems end a job, is an exception: nothing half-written is left."""
    if threading.current_thread() is not threading.main_thread() or signal.getsignal(signal.SIGTERM) != signal.SIG_DFL:
        yield
        return

    def end(*_: Any) -> NoReturn:
        raise SystemExit(ENDED)

    signal.signal(signal.SIGTERM, end)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_DFL)


@click.group(cls=_Commands, commands=_OnUse(), context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="pnp-sci")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """Videos from snapshot compressive measurements, of one view, two, or more.

    Exit codes: 0 done, 1 failed, 2 wrong command line, 143 ended by SIGTERM.
    """
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # a name of a file may have what the terminal has not
