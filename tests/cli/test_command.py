"""The command ``pnp-sci`` as such: help, the demo, and failures in one line."""

import os
import re
import subprocess
import sys
import time
from importlib import import_module
from pathlib import Path

import click
import imageio.v3
import numpy as np
import pytest
from click.testing import CliRunner
from command_line import fails, run, subcommand

import pnp_sci.api
from pnp_sci import io
from pnp_sci.cli import outputs
from pnp_sci.cli.main import main
from pnp_sci.formats import arrays
from pnp_sci.results import storage
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result

pytest_plugins = "with_files"


def test_help_is_quick_and_names_every_command():
    seconds = []
    for _ in range(3):
        start = time.perf_counter()
        done = subcommand("--help")
        seconds.append(time.perf_counter() - start)
    assert min(seconds) < 0.5
    assert done.returncode == 0
    assert set(re.findall(r"^  (\w+) ", done.stdout, re.M)) >= {
        "demo",
        "solve",
        "simulate",
        "info",
        "bench",
        "compare",
        "priors",
    }


@pytest.mark.parametrize("command", ["demo", "solve", "simulate", "info", "bench", "recommend", "compare", "priors"])
def test_every_option_is_explained(command):
    done = run(command, "--help")
    assert done.exit_code == 0
    for parameter in main.commands[command].params:
        explained = isinstance(parameter, click.Option) and (parameter.help or parameter.name == "seed")
        assert isinstance(parameter, click.Argument) or explained, parameter.name


def test_help_loads_nothing_heavy():
    code = (
        "import sys; from click.testing import CliRunner; from pnp_sci.cli.main import main\n"
        "assert CliRunner().invoke(main, ['solve', '--help']).exit_code == 0\n"
        "print(*{'numpy', 'numba', 'scipy', 'torch', 'matplotlib'} & set(sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == ""


def test_demo_in_a_process_scores_and_shows_two_views(tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("av")
    done = subcommand("demo", "--size", 64, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    scores = re.findall(r"View (\d): PSNR ([\d.]+) dB, SSIM ([\d.]+)", done.stdout)
    assert [view for view, _, _ in scores] == ["1", "2"]
    assert all(float(psnr) > 15 for _, psnr, _ in scores)
    assert re.search(r"[\d.]+ seconds for \d+ iterations: the ", done.stdout)
    assert re.search(r"[\d.]+ seconds the first time", done.stdout)
    assert sorted(os.listdir(tmp_path)) == ["demo.mp4", "demo.png"]
    assert "Written: demo.png, demo.mp4" in done.stdout
    assert io.read(tmp_path / "demo.mp4").shape == (10, 2 * 64, 3 * 64)
    assert imageio.v3.imread(tmp_path / "demo.png").std() > 10


def test_wrong_command_lines_exit_with_2(meas):
    assert "No such command 'slove'" in fails(2, "slove")
    assert "'none.npz' does not exist" in fails(2, "solve", "none.npz")
    assert "--option: 'inner' came, KEY=VALUE was expected" in fails(2, "solve", meas, "--option", "inner")
    assert "'noise' came, an option of the prior, or one of" in fails(2, "solve", meas, "--option", "noise=3")
    assert "NAME:ITERATIONS" in fails(2, "solve", meas, "--prior", "tv:many")
    assert "auto or a number" in fails(2, "solve", meas, "--noise", "much")
    assert "--index: 0 came, but the file has 1 measurement" in fails(2, "solve", meas, "--index", 0)
    assert "tv" in fails(2, "solve", meas, "--prior", "vt")
    assert "there is no folder nowhere" in fails(2, "solve", meas, "--out", "nowhere/a.npz")
    assert "there is no folder nowhere" in fails(2, "compare", meas, "--html", "nowhere/a.html")
    io.write("y.npy", io.read_measurement(meas))
    for command in ("solve", "compare"):
        assert "y.npy holds a single array of real numbers" in fails(2, command, "y.npy")
    assert not Path("result.npz").exists()


@pytest.mark.parametrize("command", ["solve", "compare"])
def test_what_is_missing_in_a_file_is_said(meas, command):
    """A complex array is left out: then there is no measurement, or there are no masks."""
    y, masks = io.read_measurement(meas), io.read_masks(meas)
    np.savez("no_y.npz", y=1j * y, masks=masks)
    np.savez("no_masks.npz", y=y, masks=1j * masks)
    assert "no measurement was recognised; the file holds masks" in fails(1, command, "no_y.npz")
    assert "holds a single array of real numbers, no masks beside it" in fails(2, command, "no_masks.npz")


@pytest.mark.parametrize(
    "command",
    ["solve {} --out r.txt", "solve {} --video r.txt", "solve {} --out r", "simulate {} --out s.txt",
     "bench --out b.csv", "bench --curves c.txt"],
)  # fmt: skip
def test_an_unknown_format_is_refused_before_any_work(monkeypatch, meas, command):
    for module, work in (("api", "solve"), ("sensing.simulate", "simulate"), ("bench", "run")):
        monkeypatch.setattr(
            import_module(f"pnp_sci.{module}"), work, lambda *given, **more: pytest.fail("work was done")
        )
    result = CliRunner().invoke(main, command.format(meas).split())
    assert result.exit_code == 2
    assert "one of these was expected: ." in result.output


def test_formats_of_results_are_those_of_the_library():
    assert set(outputs.SAVED) == set(storage.SUFFIXES)
    assert set(outputs.ARRAYS) == arrays.CONTAINERS
    assert set(outputs.SHOWN) == {*arrays.VIDEO, ".tif", ".tiff", ".png"}


def test_unreadable_files_exit_with_1_and_one_line(here):
    Path("broken.npz").write_bytes(b"PK but no archive")
    Path("notes.txt").write_text("y")
    for command in (["info"], ["solve"], ["simulate"]):
        assert fails(1, *command, "broken.npz").startswith("Error: broken.npz is not an NPZ archive")
    assert "cannot read .txt" in fails(1, "info", "notes.txt")


def test_masks_of_another_size_exit_with_1(meas):
    io.write("small.npz", {"masks": np.ones((2, 3, 8, 8))})
    line = fails(1, "solve", meas, "--masks", "small.npz")
    assert "8" in line
    assert "32" in line


def test_debug_shows_where_it_failed(here):
    Path("broken.npz").write_bytes(b"PK but no archive")
    done = subcommand("--debug", "info", "broken.npz", cwd=here)
    assert done.returncode == 1
    assert "Traceback" in done.stderr
    assert "FormatError: broken.npz is not" in done.stderr


def test_a_bug_is_named_by_its_type(monkeypatch, meas):
    def broken(*_, **__):
        raise KeyError("lost")

    monkeypatch.setattr(pnp_sci.api, "solve", broken)
    assert fails(1, "solve", meas) == "Error: KeyError: 'lost'"


def test_a_numerical_failure_is_saved_and_exits_with_1(monkeypatch, meas):
    failed = Result(np.ones((2, 10, 32, 32)), Status.NOT_FINITE, History([Record(3, 1.0, 0.5, 0.1)]), {})
    monkeypatch.setattr(pnp_sci.api, "solve", lambda *_, **__: failed)
    assert fails(1, "solve", meas) == f"Error: {Status.NOT_FINITE.value} (3 iterations in 1 s)"
    assert Result.load("result.npz").status is Status.NOT_FINITE
