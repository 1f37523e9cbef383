"""Runs ``pnp-sci``: ``from command_line import fails, run, subcommand``."""

import os
import subprocess
import sys
from pathlib import Path

from click.testing import CliRunner

from pnp_sci.cli.main import main


def run(*arguments):
    return CliRunner().invoke(main, [str(a) for a in arguments])


def fails(code, *arguments):
    """The one line that a failing command prints on stderr."""
    done = run(*arguments)
    assert done.exit_code == code, done.output
    assert "Traceback" not in done.output
    assert not isinstance(done.exception, AssertionError)
    return done.stderr.strip().splitlines()[-1]


def subcommand(*arguments, **kept):
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    return subprocess.run(
        [sys.executable, "-m", "pnp_sci", *map(str, arguments)], capture_output=True, text=True, env=environment, **kept
    )
