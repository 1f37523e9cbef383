"""The commands ``pnp-sci solve`` and ``pnp-sci simulate``."""

import re
from pathlib import Path

import numpy as np
import pytest
from command_line import fails, run

import pnp_sci.api
from pnp_sci import io
from pnp_sci.datasets import embedded_scene
from pnp_sci.results.history import History, Status
from pnp_sci.results.result import Result
from pnp_sci.sensing.simulate import simulate

pytest_plugins = "with_files"


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
        " --time-budget 2 --threads 2 --seed 3 --register --sequence --mosaic BGGR"
    )
    done = run("solve", meas, *arguments.split(), "--option", "inner=5", "--option", "mode=soft")
    assert done.exit_code == 0, done.output
    assert received == {
        "prior": [("tv", 6), ("wavelet", 2)],
        "algorithm": "admm",
        "bad": None,
        "init": "zeros",
        "effort": "fast",
        "iterations": 8,
        "noise": 0.01,
        "time_budget": 2.0,
        "threads": 2,
        "seed": 3,
        "register": True,
        "sequence": True,
        "mosaic": "BGGR",
        "device": None,
        "backend": None,
        "reference": None,
        "peak": None,
        "uncertainty": False,
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
    bad = np.zeros(y.shape, bool)
    bad[1, :3] = True
    io.write("bad.npy", bad)
    run("solve", "m.h5", "--iterations", 3, "--index", 1, "--bad", "bad.npy", "--out", "without.npz")
    assert Result.load("without.npz").scene["bad"] == 3 * 32
    io.write("of_one.npz", {"x": truth[1]})
    scored = run("solve", "m.h5", "--iterations", 3, "--index", 1, "--reference", "of_one.npz")
    assert scored.output.splitlines()[1:3] == one.output.splitlines()[1:3], "View 1: PSNR ..."
    again = run("solve", "m.h5", "--iterations", 3, "--reference", "result.npz", "--out", "again.npz")
    assert "--reference is left out" in again.output, "one video is no truth of two measurements"
    run("solve", "m.h5", "--iterations", 3)
    both = run("solve", "m.h5", "--iterations", 3, "--reference", "result.npz", "--out", "again.npz")
    assert "PSNR" in both.output, both.output
    io.write("three.npz", {"x": np.stack([truth[0]] * 3)})
    left = run("solve", "m.h5", "--iterations", 3, "--index", 1, "--reference", "three.npz").output
    assert "--reference is left out: reference has 3 videos: one, or 2" in left
    io.write("long.npz", {"x": films[:, :15]})
    assert "reference has shape (2, 15, 32, 32)" in run("solve", "m.h5", "--reference", "long.npz").output


def test_bad_pixels_in_a_file_of_several_arrays(meas):
    """Bug: there was no way to say which one is meant."""
    bad = np.zeros((32, 32), bool)
    bad[:3] = True
    io.write("several.npz", {"bad": bad, "dead": bad[::-1], "hot": bad[:, ::-1] & bad.T})
    io.write("others.npz", {"dead": bad, "hot": bad.T})
    for words, expected in (
        (("several.npz",), bad),
        (("several.npz", "--bad-key", "hot"), bad[:, ::-1] & bad.T),
        (("others.npz", "--bad-key", "dead"), bad),
    ):
        assert run("solve", meas, "--iterations", 2, "--bad", *words).exit_code == 0
        assert Result.load("result.npz").scene["bad"] == expected.sum()
    assert "dead and hot could each be" in fails(1, "solve", meas, "--bad", "others.npz")
    assert "--bad-key: 'hot' came, but no file" in fails(2, "solve", meas, "--bad", "auto", "--bad-key", "hot")


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


def test_simulate_takes_no_grey_levels_of_unknown_scale(here):
    grey = np.arange(2 * 8 * 8).reshape(2, 8, 8)
    io.write("big_endian.npy", grey.astype(">u2"))
    done = run("simulate", "big_endian.npy", "--out", "big.npz")
    assert done.exit_code == 0
    assert "white is taken to be 255" in done.stderr
    assert io.read("big.npz", "x").max() == pytest.approx(127 / 255)
    io.write("several.npz", {"x": np.zeros((3, 2, 4, 8, 8))})
    assert "several.npz holds the videos of 3 measurements" in fails(1, "simulate", "several.npz", "--out", "m.npz")
    for name, video, message in (
        ("f", grey.astype(float), "video has values up to 127: floats in [0, 1]"),
        ("i", grey, "video has dtype int64: floats in [0, 1], uint8 or uint16"),
    ):
        io.write(f"{name}.npy", video)
        assert message in fails(1, "simulate", f"{name}.npy", "--out", "m.npz")
    assert not Path("m.npz").exists()


def test_the_camera_on_the_command_line(meas, tmp_path):
    words = "--noise", 0.1, "--gain", 0.01, "--full-scale", 6, "--bits", 8
    for command, out in (("solve", ("--out", tmp_path / "r.npz")), ("compare", ("--priors", "tv", "--iterations", 2))):
        assert run(command, meas, *words, *out).exit_code == 0
    settings = Result.load(tmp_path / "r.npz").settings
    assert settings["sensor"] == {
        "read_noise": 0.1, "gain": 0.01, "full_scale": 6.0, "bits": 8, "black_level": 0.0
    }  # fmt: skip
    assert "beside a gain" in fails(2, "solve", meas, "--gain", 1)
    assert "full_scale is None" in fails(2, "compare", meas, "--noise", 1, "--bits", 8)


def test_consecutive_measurements_with_masks_of_their_own(here):
    scene = embedded_scene(32)
    masks = np.stack([np.roll(scene.masks, shift, axis=-1) for shift in range(3)])
    y = np.stack([simulate(scene.truth, own) for own in masks])
    io.write("film.npz", {"y": y, "masks": masks, "x": np.stack([scene.truth] * 3)})
    done = run("solve", "film.npz", "--sequence", "--iterations", 4, "--reference", "film.npz", "--out", "r.npz")
    assert done.exit_code == 0, done.output
    expected = pnp_sci.api.solve(y, masks, sequence=True, iterations=4)
    assert np.allclose(Result.load("r.npz").x, expected.x, atol=1e-5)
    done = run("solve", "film.npz", "--index", 1, "--iterations", 4, "--out", "one.npz")
    assert done.exit_code == 0, done.output
    assert np.allclose(Result.load("one.npz").x, pnp_sci.api.solve(y[1], masks[1], iterations=4).x, atol=1e-5)
    assert "sequence is True" in fails(1, "solve", "film.npz", "--sequence", "--index", 1)


@pytest.mark.parametrize("suffix", ["npz", "h5", "mat"])
def test_colours_from_end_to_end(here, suffix):
    """A colour film is measured, solved and scored; the result is in colour, and so is the picture of it."""
    ramp = np.linspace(0.2, 1, 32)[:, None] * np.array([0.9, 0.6, 0.3])
    io.write("video.npz", {"video": np.broadcast_to(ramp, (2, 3, 32, 32, 3)).astype(np.float32)})
    raw = f"raw.{suffix}"
    done = run("simulate", "video.npz", "--mosaic", "GRBG", "--out", raw)
    assert done.exit_code == 0, done.output
    done = run("solve", raw, "--mosaic", "GRBG", "--reference", raw, "--out", f"r.{suffix}", "--video", "r.png")
    assert done.exit_code == 0, done.output
    assert float(re.search(r"View 2: PSNR ([\d.]+) dB", done.output)[1]) > 25
    back = Result.load(f"r.{suffix}")
    assert back.x.shape == (2, 3, 32, 32, 3)
    assert np.allclose(back.x.mean((0, 1, 2, 3)), ramp.mean(0), atol=0.05)


@pytest.mark.parametrize("out", ["r.mat", "r.zarr"])
def test_results_travel_from_the_command_line(meas, out):
    pytest.importorskip("zarr")
    words = "solve", meas, "--iterations", 3, "--out", out, "--fps", 5, "--white", "1,0.2"
    for _ in range(2):  # the second replaces the first
        done = run(*words, "--video", "r.tif")
        assert done.exit_code == 0, done.output
    result = Result.load(out)
    assert np.array_equal(io.read("r.tif"), result.x)
    film = run(*words, "--video", "r.gif")
    assert f"Written: {out}, r.gif (5 frames per second)" in film.output
    assert "one a view" in fails(2, *words[:-1], "dark")
    assert "3 values came" in fails(2, *words[:-1], "1,2,3", "--video", "r.gif")


def test_messages_say_what_was_expected(here):
    scene = embedded_scene(64)
    y = scene.y.copy()
    y[3, 4] = np.nan
    io.write(here / "nan.npz", {"y": y, "masks": scene.masks})
    assert 'bad="auto" leaves such pixels out, as does bad=, a picture' in fails(1, "solve", here / "nan.npz")
    io.write(here / "odd.npz", {"a": scene.y, "b": scene.masks})
    assert "name the measurement by key=" in fails(1, "solve", here / "odd.npz")
    assert "name the masks by key=" in fails(1, "solve", here / "odd.npz", "--key", "a")
    io.write(here / "one.npy", scene.y)
    assert "'half' came, moving, random or a file" in fails(2, "simulate", here / "one.npy", "--masks", "half")
    assert "(pictures, rows, columns)" in fails(1, "calibrate", here / "one.npy")
