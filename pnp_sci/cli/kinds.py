"""Paths and numbers on the command line of ``pnp-sci``, and commands whose paths are checked before any work."""

from __future__ import annotations

import os
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from pnp_sci._optional import needed_for
from pnp_sci.errors import MissingExtraError
from pnp_sci.formats.replacing import check_writable, same_file

FILE = click.Path(exists=True, path_type=Path)

NEEDED = {  # package and extra that a format of outputs needs
    **dict.fromkeys((".h5", ".hdf5"), ("h5py", "hdf5")),
    **dict.fromkeys((".mp4", ".avi", ".mov", ".mkv", ".gif"), ("av", "video")),
    ".zarr": ("zarr", "zarr"),
}


class Output(click.Path):
    """A path that something can be written to, in one of these formats: that is known before any work is done.

    `needs` is the package that writes it, and its extra; by default as the format needs it.
    """

    def __init__(self, *suffixes: str, needs: tuple[str, str] | None = None):
        super().__init__(path_type=Path)
        self.suffixes, self.needs = suffixes, needs

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, if it can be written to."""
        path = Path(super().convert(value, param, ctx))  # type: ignore[arg-type]
        if self.suffixes and path.suffix.lower() not in self.suffixes:
            came = path.suffix or "no suffix"
            self.fail(f"{path}: {came} came, one of these was expected: {', '.join(self.suffixes)}", param, ctx)
        try:
            check_writable(path)
            if needs := self.needs or NEEDED.get(path.suffix.lower()):
                with needed_for(str(path), needs[1]):
                    import_module(needs[0])
        except OSError as error:
            self.fail(f"{path}: {error.strerror}" if error.filename else str(error), param, ctx)
        except MissingExtraError as error:
            self.fail(str(error), param, ctx)
        return path


class Folder(click.Path):
    """A folder for outputs, which is made where it is missing."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The path, if it is a folder or can be made."""
        path = Path(super().convert(value, param, ctx))  # type: ignore[arg-type]
        there = next(place for place in (path.absolute(), *path.absolute().parents) if place.exists())
        if not there.is_dir() or not os.access(there, os.W_OK):
            what = "is a file, where a folder was expected" if there.is_file() else "cannot be written to"
            self.fail(f"{path}: {there} {what}", param, ctx)
        return path


class Command(click.Command):
    """A command that refuses, before any work, to write over one of its inputs or twice to the same file."""

    def invoke(self, ctx: click.Context) -> Any:
        """Check the paths, then run the command."""
        inputs, outputs = [], []
        for param in self.params:
            value = ctx.params.get(param.name or "")
            paths = [p for p in (value if isinstance(value, tuple) else [value]) if isinstance(p, Path)]
            if param.type is FILE:
                name = param.human_readable_name if isinstance(param, click.Argument) else param.opts[0]
                inputs += [(name, path) for path in paths]
            elif isinstance(param.type, click.Path):
                outputs += [(param.opts[0], path) for path in paths]
            elif isinstance(value, str):  # a name or a file, or several
                inputs += [(param.opts[0], Path(word)) for word in value.split(",") if Path(word).is_file()]
        for n, (option, path) in enumerate(outputs):
            for other, taken in inputs + outputs[:n]:
                if same_file(path, taken):
                    raise click.UsageError(f"{option} {path} is the file of {other}: it would be lost")
        return super().invoke(ctx)


FOLDER = Folder(path_type=Path)
FIGURE = Output(".svg", ".png", ".pdf", needs=("matplotlib", "plot"))
PAGE = Output(needs=("jinja2", "report"))
SEED = click.IntRange(min=0)
POSITIVE = click.FloatRange(min=0, min_open=True)
