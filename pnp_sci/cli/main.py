"""The command ``pnp-sci``: its commands are imported on use, and what is heavy by the command that needs it."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from io import TextIOWrapper
from typing import Any

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
        if ctx.params["debug"]:
            return super().invoke(ctx)
        try:
            return super().invoke(ctx)
        except (click.ClickException, click.exceptions.Exit, click.Abort):
            raise
        except UnknownPluginError as error:
            raise click.UsageError(str(error)) from error
        except Exception as error:
            text = " ".join(str(error).split())
            known = isinstance(error, (ValueError, TypeError, OSError, RuntimeError, ImportError)) and text
            raise click.ClickException(text if known else f"{type(error).__name__}: {text}") from error


@click.group(cls=_Commands, commands=_OnUse(), context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="pnp-sci")
@click.option("--debug", is_flag=True, help="Show the traceback of an error.")
def main(debug: bool) -> None:
    """Videos from snapshot compressive measurements, of one view, two, or more.

    Exit codes: 0 done, 1 failed, 2 wrong command line.
    """
    if isinstance(sys.stdout, TextIOWrapper) and sys.stdout.errors == "strict":
        sys.stdout.reconfigure(errors="backslashreplace")  # a name of a file may have what the terminal has not
