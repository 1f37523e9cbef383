"""Killed workers, killed clients, and the command."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from small import FAST, capture, files

import pnp_sci
from pnp_sci.cli.main import main
from pnp_sci.errors import InputError

distributed = pytest.importorskip("distributed")
pytest.importorskip("zarr")
posix = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="needs SIGKILL")
SLOW = {"iterations": 150, "tol": 0.0}
COUNT = 16


def done(out):
    return len(list((out / "records").glob("0*.json")))


def until(reached, seconds=60):
    end = time.monotonic() + seconds
    while not reached():
        assert time.monotonic() < end
        time.sleep(0.01)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Files of a capture and its masks, and the videos of a run that nothing disturbed."""
    folder = tmp_path_factory.mktemp("capture")
    y, masks = capture(COUNT)
    np.save(folder / "y.npy", y)
    np.save(folder / "masks.npy", masks)
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=False, dashboard_address=":0") as cluster,
        distributed.Client(cluster) as client,
    ):
        pnp_sci.reconstruct(folder / "y.npy", masks, folder / "v.zarr", client, **SLOW)
    return folder, files(folder / "v.zarr")


def command(folder, out):
    code = "from pnp_sci.cli.main import main; main()"
    options = ["--masks", folder / "masks.npy", "--out", out, "--iterations", SLOW["iterations"], "--workers", 1]
    return [sys.executable, "-c", code, "reconstruct", *map(str, [folder / "y.npy", *options, "--option", "inner=2"])]


@posix
def test_a_killed_worker_is_replaced(undisturbed, tmp_path):
    folder, expected = undisturbed
    out = tmp_path / "v.zarr"
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, memory_limit=0, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        (worker,) = client.run(os.getpid).values()

        def kill():
            until(lambda: done(out) >= 3)
            os.kill(worker, signal.SIGKILL)

        killer = threading.Thread(target=kill)
        killer.start()
        result = pnp_sci.reconstruct(folder / "y.npy", np.load(folder / "masks.npy"), out, client, **SLOW)
        killer.join()
        assert list(client.run(os.getpid).values()) != [worker]
        assert client.status == "running"  # it was the caller's
    assert result.ok
    assert files(out) == expected


@posix
def test_a_killed_command_goes_on_where_it_was(tmp_path, undisturbed):
    folder, _ = undisturbed
    out, environment = tmp_path / "v.zarr", {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    first = subprocess.Popen(command(folder, out), env=environment, stderr=subprocess.PIPE)
    until(lambda: done(out) >= 3)
    with pytest.raises(InputError, match="another run is writing"):
        pnp_sci.reconstruct(
            folder / "y.npy", np.load(folder / "masks.npy"), out, iterations=SLOW["iterations"], inner=2
        )
    first.send_signal(signal.SIGKILL)
    first.communicate()
    time.sleep(0.5)  # its worker ends with it
    before = done(out)
    assert 3 <= before < COUNT
    kept = (out / "records" / "0000001.json").stat().st_mtime_ns
    second = subprocess.run(command(folder, out), env=environment, capture_output=True, text=True)
    assert second.returncode == 0, second.stderr
    assert f"{COUNT - before - 1} measurements on 1 worker" in second.stderr
    assert (out / "records" / "0000001.json").stat().st_mtime_ns == kept
    result = pnp_sci.Reconstruction(out)
    masks = np.load(folder / "masks.npy")
    for n in (0, before - 1, before, COUNT - 1):
        alone = pnp_sci.solve(np.load(folder / "y.npy")[n], masks, iterations=SLOW["iterations"], inner=2)
        np.testing.assert_array_equal(result.video(n), alone.x)


def test_a_scheduler_may_be_elsewhere(tmp_path, monkeypatch):
    """By its address; a failed measurement is told, and makes the command fail."""
    monkeypatch.chdir(tmp_path)
    y, masks = capture(3, dtype=np.float32)
    y[1] = np.nan
    np.save("y.npy", y)
    np.save("masks.npy", masks)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=":0"
    ) as cluster:
        arguments = ["reconstruct", "y.npy", "--masks", "masks.npy", "--scheduler", cluster.scheduler_address]
        run = CliRunner().invoke(main, [*arguments, "--iterations", str(FAST["iterations"])])
    assert run.exit_code == 1, run.output
    assert "1 failed" in run.stdout
    assert "Measurement 1: InputError: y has 576 values that are NaN" in run.stderr
    assert pnp_sci.Reconstruction("video.zarr").table()[2]["ok"]
