import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import click
import imageio.v3
import numpy as np
import pytest
from click.testing import CliRunner

import pnp_sci.api
import pnp_sci.bench
from pnp_sci import io
from pnp_sci.cli import main as cli
from pnp_sci.cli.main import main
from pnp_sci.datasets import embedded_scene
from pnp_sci.formats import arrays as _formats
from pnp_sci.plugins import registry
from pnp_sci.results.history import History, Record, Status
from pnp_sci.results.result import Result
from pnp_sci.sensing.simulate import simulate


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def meas(here):
    """A file with y, its masks and the true video."""
    scene = embedded_scene(32)
    io.write("meas.npz", {"y": scene.y, "masks": scene.masks, "x": scene.truth})
    return "meas.npz"


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
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    return subprocess.run(
        [sys.executable, "-m", "pnp_sci", *map(str, arguments)], capture_output=True, text=True, env=environment, **kept
    )


# ---- the command as such -------------------------------------------------------------------------------------------


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
        "import sys; from click.testing import CliRunner; from pnp_sci.cli import main\n"
        "assert CliRunner().invoke(main, ['solve', '--help']).exit_code == 0\n"
        "print(*{'numpy', 'numba', 'scipy', 'torch', 'matplotlib'} & set(sys.modules))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.strip() == ""


def test_demo_in_a_process_scores_and_shows_two_views(tmp_path):
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
    assert io.read(tmp_path / "demo.mp4").shape == (10, 64, 128)
    assert imageio.v3.imread(tmp_path / "demo.png").std() > 10


# ---- failures ------------------------------------------------------------------------------------------------------


def test_wrong_command_lines_exit_with_2(meas):
    assert "No such command 'slove'" in fails(2, "slove")
    assert "'none.npz' does not exist" in fails(2, "solve", "none.npz")
    assert "--option: 'inner' came, KEY=VALUE was expected" in fails(2, "solve", meas, "--option", "inner")
    assert "NAME:ITERATIONS" in fails(2, "solve", meas, "--prior", "tv:many")
    assert "auto or a number" in fails(2, "solve", meas, "--noise", "much")
    assert "--index: 0 came, but the file has 1 measurement" in fails(2, "solve", meas, "--index", 0)
    assert "tv" in fails(2, "solve", meas, "--prior", "vt")
    assert "there is no folder nowhere" in fails(2, "solve", meas, "--out", "nowhere/a.npz")
    assert "there is no folder nowhere" in fails(2, "compare", meas, "--html", "nowhere/a.html")
    io.write("y.npy", io.read_measurement(meas))
    for command in ("solve", "compare"):
        assert "y.npy holds a single array" in fails(2, command, "y.npy")
    assert not Path("result.npz").exists()


@pytest.mark.parametrize(
    "command",
    ["solve {} --out r.txt", "solve {} --video r.txt", "solve {} --out r", "simulate {} --out s.txt",
     "bench --out b.csv", "bench --curves c.txt"],
)  # fmt: skip
def test_an_unknown_format_is_refused_before_any_work(monkeypatch, meas, command):
    for module, work in (("api", "solve"), ("simulate", "simulate"), ("bench", "run")):
        monkeypatch.setattr(sys.modules[f"pnp_sci.{module}"], work, lambda *given, **more: pytest.fail("work was done"))
    result = CliRunner().invoke(main, command.format(meas).split())
    assert result.exit_code == 2
    assert "one of these was expected: ." in result.output


def test_formats_of_results_are_those_of_the_library():
    assert set(cli.SAVED) == {".npz", *pnp_sci.results.result._HDF5}
    assert set(cli.ARRAYS) == _formats.CONTAINERS
    assert set(cli.SHOWN) == {*_formats.VIDEO, ".tif", ".tiff", ".png"}


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


# ---- solve and simulate --------------------------------------------------------------------------------------------


def test_solve_writes_what_solve_returns(meas):
    done = run("solve", meas, "--iterations", 5, "--out", "r.h5", "--video", "r.gif", "--reference", meas)
    assert done.exit_code == 0, done.output
    scene = embedded_scene(32)
    expected = pnp_sci.api.solve(scene.y, scene.masks, iterations=5)
    back = Result.load("r.h5")
    assert np.allclose(back.x, expected.x, atol=1e-5)
    assert back.history[-1].iteration == 5
    assert io.read("r.gif").shape == (10, 32, 64)
    assert re.search(r"View 2: PSNR [\d.]+ dB", done.output)
    assert "Written: r.h5, r.gif" in done.output


def test_solve_hands_on_every_option(monkeypatch, meas):
    received = {}

    def recorded(y, masks, prior, **options):
        received.update(options, prior=prior)
        return Result(np.ones(masks.shape), Status.CONVERGED, History(), {})

    monkeypatch.setattr(pnp_sci.api, "solve", recorded)
    arguments = (
        "--prior tv:6,wavelet:2 --algorithm admm --init zeros --effort fast --iterations 8 --noise 0.01"
        " --time-budget 2 --threads 2 --seed 3"
    )
    done = run("solve", meas, *arguments.split(), "--option", "inner=5", "--option", "mode=soft")
    assert done.exit_code == 0, done.output
    assert received == {
        "prior": [("tv", 6), ("wavelet", 2)],
        "algorithm": "admm",
        "init": "zeros",
        "effort": "fast",
        "iterations": 8,
        "noise": 0.01,
        "time_budget": 2.0,
        "threads": 2,
        "seed": 3,
        "device": None,
        "reference": None,
        "progress": False,
        "inner": 5,
        "mode": "soft",
    }


def test_several_measurements_and_one_of_them(here):
    scene = embedded_scene(32)
    truth = np.stack([scene.truth, scene.truth[:, ::-1]])
    y = np.stack([simulate(x, scene.masks) for x in truth])
    films = truth.swapaxes(0, 1).reshape(2, 20, 32, 32)
    io.write("m.h5", {"y": y, "masks": scene.masks, "x": films})
    both = run("solve", "m.h5", "--iterations", 3, "--reference", "m.h5")
    assert both.exit_code == 0, both.output
    assert Result.load("result.npz").x.shape == (2, 2, 10, 32, 32)
    second = Result.load("result.npz").x[1]
    one = run("solve", "m.h5", "--iterations", 3, "--index", 1, "--out", "one.npz", "--reference", "m.h5")
    assert one.exit_code == 0, one.output
    assert np.allclose(Result.load("one.npz").x, second, atol=1e-5)
    assert "--index: 2 came" in fails(2, "solve", "m.h5", "--index", 2)
    io.write("of_one.npz", {"x": truth[1]})
    scored = run("solve", "m.h5", "--iterations", 3, "--index", 1, "--reference", "of_one.npz")
    assert scored.output.splitlines()[1:3] == one.output.splitlines()[1:3], "View 1: PSNR ..."
    again = run("solve", "m.h5", "--iterations", 3, "--reference", "result.npz", "--out", "again.npz")
    assert again.exit_code == 1, "one video is no truth of two measurements"
    run("solve", "m.h5", "--iterations", 3)
    assert run("solve", "m.h5", "--iterations", 3, "--reference", "result.npz").exit_code == 0
    io.write("three.npz", {"x": np.stack([truth[0]] * 3)})
    assert "3 videos: one, or 2" in fails(1, "solve", "m.h5", "--index", 1, "--reference", "three.npz")
    io.write("long.npz", {"x": films[:, :15]})
    assert "reference has shape (2, 15, 32, 32)" in fails(1, "solve", "m.h5", "--reference", "long.npz")


def test_scores_are_the_same_in_grey_levels(meas):
    scene = embedded_scene(32)
    grey = (255 * scene.truth).round().astype(np.uint8)
    io.write("grey.npz", {"y": simulate(grey, scene.masks), "masks": scene.masks, "x": grey})
    scores = []
    for file in (meas, "grey.npz"):
        output = run("solve", file, "--iterations", 5, "--reference", file).output
        scores.append([float(number) for number in re.findall(r"View \d: PSNR ([\d.]+) dB", output)])
    assert len(scores[0]) == 2
    assert scores[1] == pytest.approx(scores[0], abs=0.05)


@pytest.mark.parametrize("masks", ["moving", "random"])
def test_simulated_files_can_be_solved(here, masks):
    scene = embedded_scene(32)
    for view, film in enumerate(scene.truth, 1):
        io.write_video(f"view{view}.avi", film)
    done = run("simulate", "view1.avi", "view2.avi", "--masks", masks, "--frames", 6, "--noise", 0.01, "--bits", 12)
    assert done.exit_code == 0, done.output
    assert "2 views x 6 frames of 32 x 32" in done.output
    truth, phi, y = io.read_video("meas.npz"), io.read_masks("meas.npz"), io.read_measurement("meas.npz")
    assert truth == pytest.approx(scene.truth[:, :6], abs=0.003)
    assert phi.shape == (2, 6, 32, 32)
    assert set(np.unique(phi)) == {0, 1}
    assert y == pytest.approx((phi * truth).sum((0, 1)), abs=0.05 * float(y.max()))
    assert not np.array_equal(y, (phi * truth).sum((0, 1)))
    assert run("solve", "meas.npz", "--iterations", 2).exit_code == 0


def test_simulate_is_reproducible_and_takes_masks_from_a_file(meas):
    for out in ("a.npz", "b.npz"):
        assert run("simulate", meas, "--masks", meas, "--noise", 0.1, "--out", out).exit_code == 0
    assert np.array_equal(io.read("a.npz", "y"), io.read("b.npz", "y"))
    assert np.array_equal(io.read("a.npz", "masks"), io.read(meas, "masks"))
    assert run("simulate", meas, "--masks", meas, "--out", "c.npz").exit_code == 0
    assert np.array_equal(io.read("c.npz", "y"), io.read(meas, "y"))


def test_videos_that_do_not_fit_are_named(here):
    io.write_video("a.avi", np.zeros((4, 32, 32)))
    io.write_video("b.avi", np.zeros((4, 32, 16)))
    assert "b.avi has 4 frames of 32 x 16: 4 of 32 x 32 were expected" in fails(1, "simulate", "a.avi", "b.avi")
    assert "frames is 9, but a.avi has 4" in fails(1, "simulate", "a.avi", "--frames", 9)


# ---- info, priors, bench -------------------------------------------------------------------------------------------


def test_simulate_takes_no_grey_levels_of_unknown_scale(here):
    grey = np.arange(2 * 8 * 8).reshape(2, 8, 8)
    io.write("big_endian.npy", grey.astype(">u2"))
    assert run("simulate", "big_endian.npy", "--out", "big.npz").exit_code == 0
    io.write("several.npz", {"x": np.zeros((3, 2, 4, 8, 8))})
    assert "several.npz holds the videos of 3 measurements" in fails(1, "simulate", "several.npz", "--out", "m.npz")
    for name, video, message in (
        ("f", grey.astype(float), "video has values up to 127: floats in [0, 1]"),
        ("i", grey, "video has dtype int64: floats in [0, 1], uint8 or uint16"),
    ):
        io.write(f"{name}.npy", video)
        assert message in fails(1, "simulate", f"{name}.npy", "--out", "m.npz")
    assert not Path("m.npz").exists()


def test_info_reports_on_arrays_masks_and_results(meas):
    done = run("info", meas)
    assert done.exit_code == 0
    assert "measurement: 32 x 32" in done.output
    assert "Masks: 2 views x 10 frames of 32 x 32, bool, binary" in done.output
    assert "the views can be told apart" in done.output
    run("solve", meas, "--iterations", 2, "--seed", 7)
    report = run("info", "result.npz").output
    assert "Result(2 views x 10 frames of 32 x 32, 2 iterations" in report
    assert json.loads(report[report.index("\n{") :])["seed"] == 7


def test_priors_lists_what_is_installed_with_a_summary(monkeypatch):
    def own():
        """Leaves everything as it is."""

    monkeypatch.setitem(registry._registered["priors"], "own", own)
    done = run("priors")
    assert done.exit_code == 0
    assert re.search(r"^  own +Leaves everything as it is\.$", done.output, re.M)
    for name in registry.available("priors"):
        assert re.search(rf"^  {re.escape(name)} +\S", done.output, re.M), name


def test_bench_makes_a_table(here):
    done = run("bench", "--iterations", 2, "--repeat", 2, "--out", "b.json", "--markdown", "b.md", "--curves", "c.svg")
    assert done.exit_code == 0, done.output
    (row,) = json.loads(Path("b.json").read_text())["rows"]
    assert (row["case"]["scene"], row["method"]["prior"], row["iterations"]) == ("embedded", "tv", 2)
    assert len(row["psnr"]) == len(row["ssim"]) == len(row["seconds"]) == 2
    assert done.stdout.startswith(Path("b.md").read_text())
    assert "| embedded | tv, 2 iterations |" in done.stdout
    assert "| within | PSNR (dB) | method | iterations |" in done.stdout
    assert Path("c.svg").stat().st_size > 5000


def test_bench_goes_on_where_it_was(here, monkeypatch):
    row = ("bench", "--iterations", 2, "--out", "b.json")
    assert run(*row).exit_code == 0
    before = Path("b.json").read_text()
    monkeypatch.setattr("pnp_sci.bench.run", lambda *_: pytest.fail("measured again"))
    done = run(*row)
    assert done.exit_code == 0, done.output
    assert "| embedded | tv, 2 iterations |" in done.stdout
    assert Path("b.json").read_text() == before


def test_recommend(here):
    done = run("recommend", 1e4, "--like", "2x10x64x64")
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("pnp_sci.solve(y, masks, prior=")
    assert "budget_seconds is 1e-09" in fails(1, "recommend", "1e-9")


def test_bench_goes_on_after_a_failure(here, monkeypatch):
    monkeypatch.setenv("PNP_SCI_DATA", str(here / "empty"))
    done = run("bench", "--cases", "kobe,embedded", "--iterations", 1)
    assert done.exit_code == 1
    assert "| embedded | tv, 1 iteration |" in done.stdout
    assert "Error: kobe with tv, 1 iteration: " in done.stderr
    assert "PNP_SCI_DATA" in done.stderr
    assert "'nowhere'" in fails(1, "bench", "--cases", "nowhere")


def test_the_camera_on_the_command_line(meas, tmp_path):
    words = "--noise", 0.1, "--gain", 0.01, "--full-scale", 6, "--bits", 8
    for command, out in (("solve", ("--out", tmp_path / "r.npz")), ("compare", ("--priors", "tv", "--iterations", 2))):
        assert run(command, meas, *words, *out).exit_code == 0
    settings = Result.load(tmp_path / "r.npz").settings
    assert settings["sensor"] == {"read_noise": 0.1, "gain": 0.01, "full_scale": 6.0, "bits": 8}
    assert "beside a gain" in fails(2, "solve", meas, "--gain", 1)
    assert "full_scale is None" in fails(2, "compare", meas, "--noise", 1, "--bits", 8)
