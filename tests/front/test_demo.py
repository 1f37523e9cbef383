"""The first thing that a newcomer runs."""

import re
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from pnp_sci import io, metrics
from pnp_sci.cli.main import COMMANDS, main
from pnp_sci.datasets import embedded_scene
from pnp_sci.plugins import registry


def demo(folder, *options):
    done = CliRunner().invoke(main, ["demo", "--out", str(folder), *options])
    assert done.exit_code == 0, done.output
    return done.output


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    pytest.importorskip("matplotlib")
    pytest.importorskip("av")
    folder = tmp_path_factory.mktemp("demo")
    return folder, demo(folder, "--size", "64")


def test_it_says_which_prior_ran_how_long_and_how_well(small):
    _, output = small
    assert re.search(r"^Prior flow: [\d.]+ seconds for \d+ iterations: the ", output, re.M)
    scores = [float(value) for value in re.findall(r"^View \d: PSNR ([\d.]+) dB, SSIM [\d.]+$", output, re.M)]
    assert len(scores) == 2
    assert min(scores) > 18


def test_the_film_shows_measurement_result_and_truth(small):
    folder, output = small
    scene, film = embedded_scene(64), io.read(folder / "demo.mp4") / 255
    measurement, result, truth = (film[..., k * 64 : (k + 1) * 64].reshape(10, 2, 64, 64) for k in range(3))
    told = [float(value) for value in re.findall(r"PSNR ([\d.]+) dB", output)]
    assert metrics.psnr(truth.swapaxes(0, 1), scene.truth).min() > 32
    assert metrics.psnr(result.swapaxes(0, 1), scene.truth) == pytest.approx(told, abs=0.5)
    assert metrics.psnr(measurement[0, 0], scene.y / scene.y.max()) > 32
    assert np.ptp(measurement.mean((1, 2, 3))) < 0.01, "it stands still"


def test_the_picture_is_wide_and_shows_something(small):
    picture = Image.open(small[0] / "demo.png")
    assert picture.width > 2 * picture.height > 400
    assert np.asarray(picture.convert("L")).std() > 30


def test_another_prior_can_be_asked_for(tmp_path):
    assert "Prior none: " in demo(tmp_path, "--size", "32", "--prior", "none")
    done = CliRunner().invoke(main, ["demo", "--prior", "vt", "--out", str(tmp_path)])
    assert done.exit_code == 2
    assert set(registry.available("priors")) <= set(re.findall(r"[\w-]+", done.output))


def test_commands_are_imported_on_use():
    assert set(main.commands) == set(COMMANDS)
    for name in main.commands:
        command = main.commands[name]
        assert command.name == name
        summary = command.get_short_help_str(60).rstrip(".")
        assert summary == (command.help or "").partition("\n")[0].rstrip("."), "it fits into a line of the help"


def test_the_picture_of_the_readme_is_small():
    picture = Path(__file__).parents[2] / "docs" / "pictures" / "demo.png"
    assert 0 < picture.stat().st_size < 200_000
