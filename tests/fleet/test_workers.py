"""What goes to workers and what they leave: sources of the client, failures, previews, memory."""

import subprocess
import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from small import FAST, Deadly, capture

import pnp_sci
from pnp_sci.plugins import registry

distributed = pytest.importorskip("distributed")
pytest.importorskip("zarr")


class Locked:
    """Measurements that cannot be sent to another process, and some of which cannot be read."""

    def __init__(self, values, broken=()):
        self.values, self.broken, self.lock = values, broken, threading.Lock()
        self.shape, self.dtype = values.shape, values.dtype

    def __getitem__(self, part):
        with self.lock:
            if any(n in self.broken for n in range(*part.indices(len(self.values)))):
                raise OSError("the disk is away")
            return self.values[part]


@pytest.fixture(scope="module")
def alone():
    y, masks = capture()
    return [pnp_sci.solve(picture, masks, **FAST, threads=1).x for picture in y]


@pytest.mark.parametrize("kind", ["array", "memmap", "locked"])
def test_the_client_reads_what_other_processes_cannot(process, tmp_path, alone, kind):
    y, masks = capture()
    np.save(tmp_path / "y.npy", y[:, ::-1])
    source = {"array": y, "memmap": np.load(tmp_path / "y.npy", mmap_mode="r")[:, ::-1], "locked": Locked(y)}[kind]
    videos = pnp_sci.reconstruct(source, masks, tmp_path / "v.zarr", process, **FAST)
    assert videos.ok
    for n, x in enumerate(alone):
        np.testing.assert_array_equal(videos.video(n), x)


def test_workers_are_not_sent_all_measurements(tmp_path, client, monkeypatch):
    import cloudpickle

    y, masks = capture(400)
    sent = []

    def register(self, plugin, *others, **options):
        sent.append(len(cloudpickle.dumps(plugin)))
        raise InterruptedError

    monkeypatch.setattr(distributed.Client, "register_plugin", register)
    with pytest.raises(InterruptedError):
        pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    assert sent[0] < y.nbytes / 10


@pytest.mark.parametrize("broken", [(0,), (2,), (3, 4), range(5)])
def test_what_cannot_be_read_stops_no_other_measurement(client, tmp_path, alone, broken):
    y, masks = capture()
    out = tmp_path / "v.zarr"
    for _ in range(2):  # also where the others are done
        videos = pnp_sci.reconstruct(Locked(y, broken), masks, out, client, **FAST, preview="wavelet")
        for n, row in enumerate(videos.table()):
            assert row["ok"] is (n not in broken)
            assert row["ok"] or row["error"] == "OSError: the disk is away"
    videos = pnp_sci.reconstruct(Locked(y), masks, out, client, **FAST)
    assert videos.ok
    np.testing.assert_array_equal(videos.video(4), alone[4])


@pytest.mark.parametrize("fails", [False, True])
@pytest.mark.parametrize("by_address", [False, True])
def test_nothing_stays_on_a_cluster_of_others(tmp_path, monkeypatch, fails, by_address):
    from pnp_sci.fleet import store

    def full(*arguments):
        raise RuntimeError("no room")

    y, masks = capture(2)
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, protocol="tcp", dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as theirs,
    ):
        before = set(*theirs.run(lambda dask_worker: list(dask_worker.plugins)).values())
        where = cluster.scheduler_address if by_address else theirs
        with monkeypatch.context() as patch:
            if fails:
                patch.setattr(store, "put_record", full)
                with pytest.raises(RuntimeError, match="no room"):
                    pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", where, **FAST)
            else:
                pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", where, **FAST)
        assert set(*theirs.run(lambda dask_worker: list(dask_worker.plugins)).values()) == before
        assert theirs.status == "running"


@pytest.mark.parametrize("name", ["put_videos", "put_record"])
def test_a_disk_that_is_full_is_named_once(client, tmp_path, monkeypatch, caplog, name):
    import errno

    from pnp_sci.fleet import store

    y, masks = capture()
    put, out = getattr(store, name), tmp_path / "v.zarr"

    def full(path, n, *others):
        if n == 2:
            raise OSError(errno.ENOSPC, "No space left on device")
        put(path, n, *others)

    with monkeypatch.context() as patch:
        patch.setattr(store, name, full)
        with pytest.raises(OSError, match=r"No space left on device; .* the same call goes on.*v\.zarr") as caught:
            pnp_sci.reconstruct(y, masks, out, client, **FAST)
    assert caught.value.errno == errno.ENOSPC
    assert not [record for record in caplog.records if record.exc_info or "Compute Failed" in record.getMessage()]
    assert pnp_sci.reconstruct(y, masks, out, client, **FAST).ok


def test_each_process_warms_up_outside_the_time_budget(client, tmp_path, monkeypatch):
    from pnp_sci.fleet import warm

    y, masks = capture()
    asked, solve = [], warm.solve

    def watched(y, masks, **options):
        asked.append((options["iterations"], options["time_budget"]))
        return solve(y, masks, **options)

    monkeypatch.setattr(warm, "solve", watched)
    assert pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST, time_budget=100.0).ok
    assert asked == [(1, None), (3, None)]


@pytest.mark.parametrize(
    ("options", "most"),
    [
        ({"prior": "bm3d", "first": 3}, 5),
        ({"prior": "bm3d", "first": 3, "iterations": 4}, 4),
        ({"prior": [("tv", 7), ("wavelet", 3)]}, 9),
        ({"prior": "wavelet"}, None),
    ],
)
def test_warming_up_reaches_the_last_prior(client, tmp_path, monkeypatch, options, most):
    """Bug: it took 62 iterations, whatever comes before that prior."""
    from pnp_sci.fleet import warm

    y, masks = capture(count=1)
    asked, solve = [], warm.solve
    monkeypatch.setattr(warm, "solve", lambda *a, **k: asked.append(k["iterations"]) or solve(*a, **k))
    assert pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **options).ok
    assert asked == [1, most]


def test_a_measurement_that_kills_its_workers_is_recorded(tmp_path, process):
    import dask

    y, masks = capture(2)
    prior, out = Deadly(str(tmp_path / "prior")), tmp_path / "v.zarr"
    armed = Path(prior.file).with_suffix(".armed")
    armed.touch()
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=True, memory_limit=0, dashboard_address=":0"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        videos = pnp_sci.reconstruct(y, masks, out, client, prior=prior, iterations=3)
    assert [row["error"].partition(":")[0] for row in videos.table()] == ["KilledWorker"] * 2
    assert np.isnan(videos.x[...]).all()
    armed.unlink()
    assert pnp_sci.reconstruct(y, masks, out, process, prior=prior, iterations=3).ok


@pytest.mark.parametrize(("available", "left"), [(0, 1), (9.9e8, 1), (1.1e9, 2), (1e12, 3)])
def test_there_are_as_many_workers_as_memory_allows(monkeypatch, available, left):
    from pnp_sci.fleet import cluster
    from pnp_sci.fleet.cluster import Team

    monkeypatch.setattr(cluster.psutil, "virtual_memory", lambda: SimpleNamespace(available=available))
    with (
        distributed.LocalCluster(n_workers=3, threads_per_worker=1, processes=False, dashboard_address=":0") as local,
        distributed.Client(local) as client,
    ):
        for own, size in ((None, 3), (local, left)):
            team = Team(client, own, None)
            team.fit(1e9)
            assert team.size == size


@pytest.mark.parametrize("takes_device", [False, True])
def test_a_decoder_makes_previews(client, tmp_path, monkeypatch, takes_device):
    """With the options that it has, within the threads that are asked for."""
    import numba

    from pnp_sci.fleet import store

    asked = []

    def black(problem, scene):
        return np.zeros(problem.op.shape, np.float32)

    def plain():
        return lambda problem, scene: asked.append(numba.get_num_threads()) or black(problem, scene)

    def with_device(device=None):
        assert device == "cpu"
        return plain()

    monkeypatch.setitem(registry._registered["decoders"], "black", with_device if takes_device else plain)
    y, masks = capture()
    said, put = [], store.put_record
    monkeypatch.setattr(store, "put_record", lambda path, n, record: (said.append(record), put(path, n, record)))
    options = {"device": "cpu", "backend": "numba", "seed": 1, "bad": None, "threads": 1}
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, preview="black", **FAST, **options)
    assert videos.ok
    previews = [record for record in said if record["method"] == "black"]
    assert [record["error"] for record in previews] == [None] * 4
    assert asked == [1] * 4


def test_each_warning_is_recorded_as_often_as_it_came(client, tmp_path):
    y, masks = capture(2)
    wrong = np.roll(masks, 5, -1)[:, :, ::-1]
    videos = pnp_sci.reconstruct(np.stack([y[0], y[0]]), wrong, tmp_path / "v.zarr", client, **FAST)
    first, second = (row["warnings"] for row in videos.table())
    assert first == second != []


def test_settings_that_json_cannot_hold_fail_alone(client, tmp_path, monkeypatch):
    """They become an error of their measurement, not a text that says nothing."""
    from pnp_sci.fleet import work

    y, masks = capture(2)
    solve = work.solve

    def odd(y, masks, **options):
        result = solve(y, masks, **options)
        result.settings["odd"] = object()
        return result

    monkeypatch.setattr(work, "solve", odd)
    videos = pnp_sci.reconstruct(y, masks, tmp_path / "v.zarr", client, **FAST)
    assert all("JSON has no such thing" in row["error"] for row in videos.table())


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="only Linux counts the memory of a parent")
def test_memory_is_that_of_the_process_alone():
    child = "from pnp_sci.accel.memory import peak_memory; print(peak_memory())"
    parent = f"import subprocess, sys; x = b'1' * 10**9; subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    done = subprocess.run([sys.executable, "-c", parent], capture_output=True, text=True, check=True)
    assert 5e6 < int(done.stdout) < 8e8
