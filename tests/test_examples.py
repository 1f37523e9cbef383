"""The examples run as a reader would run them: on small settings, without the benchmark's files."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from pnp_sci import io

EXAMPLES = Path(__file__).parents[1] / "examples"
WRITTEN = {
    "quickstart": {"quickstart.png", "quickstart.mp4", "quickstart.npz"},
    "compare_priors": {"compare.png"},
    "replay_real_wheel": {"wheel.png", "wheel.mp4"},
    "replay_real_dual": {"dual.png", "dual.mp4"},
    "own_prior": set(),
    "notebook": set(),
    "what_is_modelled": {"modelled.jpg"},
}
CAPTURES = [("replay_real_wheel", (14, 256, 256)), ("replay_real_dual", (14, 240, 480))]


def run(name, tmp_path, **environment):
    arguments = ["--small"] + (["--out", str(tmp_path / "out")] if WRITTEN[name] else [])
    return subprocess.run(
        [sys.executable, str(EXAMPLES / f"{name}.py"), *arguments],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(EXAMPLES.parent), **environment},
    )


def test_every_example_is_run_here():
    assert {path.stem for path in EXAMPLES.glob("*.py")} == set(WRITTEN)


@pytest.mark.parametrize("name", WRITTEN)
def test_example_runs_without_data(name, tmp_path):
    nowhere = str(tmp_path / "empty")
    offline = {name: "http://127.0.0.1:9" for name in ("http_proxy", "https_proxy", "HTTPS_PROXY")}
    done = run(name, tmp_path, PNP_SCI_DATA=nowhere, XDG_CACHE_HOME=nowhere, **offline)
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    if name.startswith("replay_real"):
        assert "The embedded scene takes its place." in done.stdout
    out = tmp_path / "out"
    assert (set(os.listdir(out)) if WRITTEN[name] else set()) == WRITTEN[name]
    for film in out.glob("*.mp4"):
        assert io.read(film).std() > 1


@pytest.mark.skipif(not os.environ.get("PNP_SCI_DATA"), reason="set PNP_SCI_DATA to the folder with the captures")
@pytest.mark.parametrize(("name", "frames"), CAPTURES)
def test_replays_use_the_captures(name, frames, tmp_path):
    done = run(name, tmp_path)
    assert done.returncode == 0, done.stderr
    assert "takes its place" not in done.stdout
    (film,) = (tmp_path / "out").glob("*.mp4")
    assert io.read(film).shape == frames
