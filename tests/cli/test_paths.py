"""Paths on the command line: nothing is lost, and what cannot be written is known before any work."""

import os
import sys

import numpy as np
import pytest
from click.testing import CliRunner
from command_line import subcommand

from pnp_sci import Result, datasets, io
from pnp_sci.cli.main import main
from pnp_sci.formats.replacing import replacing

SCENE = datasets.embedded_scene(32)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    io.write("m.npz", {"y": SCENE.y, "masks": SCENE.masks, "x": SCENE.truth})
    return tmp_path


def call(*words):
    return CliRunner().invoke(main, words)


@pytest.mark.parametrize(
    "words",
    [
        ("solve", "m.npz", "--out", "m.npz"),
        ("solve", "m.npz", "--out", "other/../m.npz"),
        ("solve", "m.npz", "--out", "link.npz"),
        ("solve", "m.npz", "--out", "r.npz", "--reference", "truth.npz", "--video", "both.mp4", "--masks", "both.mp4"),
        ("solve", "m.npz", "--bad", "truth.npz", "--out", "truth.npz"),
        ("solve", "m.npz", "--masks", "truth.npz", "--out", "truth.npz"),
        ("simulate", "m.npz", "--out", "m.npz"),
        ("simulate", "m.npz", "--masks", "truth.npz", "--out", "truth.npz"),
        ("bench", "--out", "a.json", "--markdown", "a.json"),
        ("compare", "m.npz", "--html", "m.npz"),
        ("compare", "m.npz", "--html", "a.html", "--json", "a.html"),
    ],
)
def test_no_output_over_an_input_or_another_output(folder, words):
    (folder / "other").mkdir()
    os.symlink("m.npz", "link.npz")
    for name in ("truth.npz", "both.mp4"):
        (folder / name).write_bytes(b"precious")
    before = {file: file.read_bytes() for file in folder.iterdir() if file.is_file()}
    done = call(*words)
    assert done.exit_code == 2
    assert "it would be lost" in done.output
    assert "_file" not in done.output
    assert {file: file.read_bytes() for file in folder.iterdir() if file.is_file()} == before


@pytest.mark.parametrize("kind", ["folder", "read-only", "no folder"])
def test_what_cannot_be_written_is_known_before_any_work(folder, monkeypatch, kind):
    monkeypatch.setattr("pnp_sci.api.solve", lambda *a, **k: pytest.fail("the solver has run"))
    target = folder / ("nowhere/r.npz" if kind == "no folder" else "r.npz")
    if kind == "folder":
        target.mkdir()
    elif kind == "read-only":
        target.write_bytes(b"precious")
        target.chmod(0o444)
    done = call("solve", "m.npz", "--out", str(target))
    assert done.exit_code == 2
    assert "r.npz" in done.output
    assert "--out" in done.output


def test_a_result_that_finds_no_place_is_kept_elsewhere(folder, monkeypatch):
    real = Result.save
    monkeypatch.setattr(Result, "save", lambda self, path: _full() if "r.npz" in str(path) else real(self, path))
    done = call("solve", "m.npz", "--iterations", "1", "--out", "r.npz")
    place = done.output.split("The result is in ")[1].splitlines()[0]
    assert Result.load(place).x.shape == SCENE.masks.shape


def _full():
    raise OSError(28, "No space left on device")


def test_a_result_that_no_library_can_write_is_kept_elsewhere(folder, monkeypatch):
    real = Result.save
    monkeypatch.setattr(Result, "save", lambda self, path: 1 / 0 if "r.mat" in str(path) else real(self, path))
    done = call("solve", "m.npz", "--iterations", "1", "--out", "r.mat")
    place = done.output.split("The result is in ")[1].splitlines()[0]
    assert Result.load(place).x.shape == SCENE.masks.shape


def test_both_places_that_are_full_are_named(folder, monkeypatch):
    (folder / "tmp").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(folder / "tmp"))
    monkeypatch.setattr(Result, "save", lambda self, path: _full())
    done = call("solve", "m.npz", "--iterations", "1", "--out", "r.npz")
    assert done.exit_code == 1
    assert "r.npz cannot be written" in done.output
    assert str(folder / "tmp") in done.output
    assert not list((folder / "tmp").iterdir())


@pytest.mark.parametrize(
    ("package", "words"),
    [
        ("h5py", ("solve", "m.npz", "--out", "r.h5")),
        ("zarr", ("solve", "m.npz", "--out", "r.zarr")),
        ("av", ("solve", "m.npz", "--video", "r.mp4")),
        ("h5py", ("simulate", "m.npz", "--out", "r.h5")),
        ("jinja2", ("compare", "m.npz", "--html", "r.html")),
        ("matplotlib", ("bench", "--curves", "r.svg")),
        ("matplotlib", ("calibrate", "m.npz", "--report", "r.png")),
    ],
)
def test_a_missing_package_is_known_before_any_work(folder, monkeypatch, package, words):
    for work in ("api.solve", "sensing.simulate.simulate", "bench.run", "bench.compare", "camera.calibrate.calibrate"):
        monkeypatch.setattr(f"pnp_sci.{work}", lambda *a, **k: pytest.fail("work was done"))
    monkeypatch.setitem(sys.modules, package, None)
    done = call(*words)
    assert done.exit_code == 2, done.output
    assert words[-2] in done.output
    assert f"needs {package}: python -m pip install" in done.output


@pytest.mark.parametrize(
    "words",
    [
        ("bench", "--markdown", "nowhere/t.md"),
        ("bench", "--markdown", "there"),
        ("bench", "--markdown", "m.npz", "--paper"),
        ("bench", "--out", "r.json", "--markdown", "r.csv"),
        ("bench", "--cases", ""),
        ("bench", "--priors", ""),
        ("demo", "--out", "m.npz"),
        ("demo", "--out", "m.npz/x"),
        ("simulate", "m.npz", "--seed", "-1"),
        ("solve", "m.npz", "--white", "1,0.2,3"),
        ("demo", "--white", "1,0.2,3"),
    ],
)
def test_a_wrong_place_is_known_before_any_work(folder, monkeypatch, words):
    (folder / "there").mkdir()
    (folder / "there" / "file").touch()
    for work in ("api.solve", "bench.run", "sensing.simulate.simulate"):
        monkeypatch.setattr(f"pnp_sci.{work}", lambda *a, **k: pytest.fail("work was done"))
    done = call(*words)
    assert done.exit_code == 2, done.output
    assert words[-2] in done.output


def test_any_name_of_a_file_will_do(folder, monkeypatch):
    """One that is not UTF-8, and one that leaves no room for another suffix."""
    odd, long = os.fsdecode(b"m\xff.npz"), "b" * 250 + ".json"
    try:
        os.link("m.npz", odd)
    except OSError:
        pytest.skip("this file system has no such names")
    done = call("compare", odd, "--priors", "none", "--iterations", "1", "--html", "r.html")
    assert done.exit_code == 0, done.output
    assert "m\\udcff.npz" in (folder / "r.html").read_text("utf-8")
    done = call("bench", "--cases", odd, "--priors", "none", "--iterations", "1", "--out", long, "--markdown", "r.md")
    assert done.exit_code == 0, done.output
    assert "m\\udcff.npz" in (folder / "r.md").read_text("utf-8")


def test_a_terminal_without_the_letters_of_a_name_is_no_failure(folder, monkeypatch):
    monkeypatch.setenv("PYTHONIOENCODING", "latin-1")
    done = subcommand("solve", "m.npz", "--iterations", 1, "--out", "r\u20ac.npz", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert r"Written: r\u20ac.npz" in done.stdout


def test_a_link_stays_and_a_device_is_written_to(folder):
    (folder / "disk").mkdir()
    io.write("disk/r.npy", np.zeros(3))
    os.symlink("disk/r.npy", "r.npy")
    io.write("r.npy", np.ones(3))
    assert os.path.islink("r.npy")
    assert io.read("disk/r.npy").tolist() == [1, 1, 1]
    with replacing(folder / "disk" / ".." / "disk" / "r.npy") as temporary:
        np.save(temporary, np.zeros(2))
    assert os.listdir("disk") == ["r.npy"]
    if os.path.exists("/dev/null"):
        with replacing(type(folder)("/dev/null")) as temporary:
            temporary.write_bytes(b"gone")
        assert not os.path.isfile("/dev/null")


def test_an_error_names_the_users_path(folder):
    with pytest.raises(OSError, match=r"r\.npz"), replacing(folder / "r.npz"):
        _full()
    assert [file.name for file in folder.iterdir()] == ["m.npz"]


@pytest.mark.parametrize("reference", ["other.npz", "nothing.npz"])
def test_a_reference_that_cannot_be_used_is_left_out(folder, reference):
    io.write("other.npz", {"x": np.ones((2, 3, 32, 32))})
    io.write("nothing.npz", {"words": np.ones(3)})
    done = call("solve", "m.npz", "--iterations", "1", "--reference", reference)
    assert done.exit_code == 0, done.output
    assert "--reference is left out" in done.output
    assert Result.load("result.npz").x.shape == SCENE.masks.shape


def test_a_reference_under_a_name_that_is_not_known(folder):
    io.write("t.npz", {"scene": SCENE.truth, "more": SCENE.y})
    done = call("solve", "m.npz", "--iterations", "1", "--reference", "t.npz", "--reference-key", "scene")
    assert "View 2: PSNR" in done.output
