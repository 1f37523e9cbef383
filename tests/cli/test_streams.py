"""The command in a pipe, without stderr, and ended by SIGTERM: as batch systems, daemons and ``head`` have it."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

import pnp_sci
from pnp_sci.bench import Method, compare

pytest_plugins = "with_files"
ROOT = Path(__file__).parents[2]
posix = pytest.mark.skipif(os.name != "posix", reason="needs a shell")


def shell(line):
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "PNP": f"{sys.executable} -m pnp_sci"}
    return subprocess.run(["bash", "-c", line], capture_output=True, text=True, env=environment)


@posix
def test_a_process_without_stderr(meas):
    done = shell("$PNP solve meas.npz --iterations 1 --out r.h5 2>&- && $PNP info r.h5 2>&-")
    assert done.returncode == 0
    assert '"prior": "tv"' in done.stdout


def test_a_bar_without_stderr(monkeypatch):
    scene = pnp_sci.datasets.embedded_scene(32)
    monkeypatch.setattr(sys, "stderr", None)
    result = pnp_sci.solve(scene.y, scene.masks, "none", iterations=1, progress=True)
    assert result.history[-1].iteration == 1
    (trial,) = compare(scene.y, scene.masks, [Method("none", iterations=1)], progress=True).trials
    assert trial.error is None


@posix
def test_a_stdout_that_nobody_reads_ends_it_without_a_word(meas):
    """The exit code is that of the command, not that of ``head``."""
    done = shell("set -o pipefail; $PNP info meas.npz | head -0")
    assert (done.returncode, done.stdout, done.stderr) == (1, "", "")


@posix
@pytest.mark.parametrize("debug", [[], ["--debug"]])
def test_sigterm_during_a_save_leaves_nothing_behind(meas, debug):
    code = f"""
import time
from pnp_sci.cli.main import main
from pnp_sci.results import storage
def slow(path, arrays, texts):
    path.write_bytes(b"half of it")
    print("writing", flush=True)
    time.sleep(60)
storage._WRITERS[".npz"] = slow
main({debug} + ["solve", "meas.npz", "--iterations", "1", "--out", "r.npz"])
"""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True, env=environment) as running:
        assert running.stdout
        assert running.stdout.readline() == "writing\n"
        assert len(os.listdir()) == 2
        running.send_signal(signal.SIGTERM)
        assert running.wait(30) == 143
    assert os.listdir() == [meas]
