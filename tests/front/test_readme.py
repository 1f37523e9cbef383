"""The README: short, and true."""

import re
from pathlib import Path

import pytest

import pnp_sci
from pnp_sci.plugins import registry

README = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")


def test_it_is_short():
    assert len(README.splitlines()) <= 150


def test_its_python_runs(tmp_path, monkeypatch):
    """All of it, one snippet after the other, on a smaller scene; and the prior of one's own beats none."""
    for module in ("torch", "matplotlib", "av"):
        pytest.importorskip(module)
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in re.findall(r"^```python\n(.*?)^```$", README, re.M | re.S):
        exec(code.replace("embedded_scene()", "embedded_scene(32)"), names)
    assert {path.name for path in tmp_path.iterdir()} == {"views.png", "views.mp4", "result.npz", "capture.npz"}
    scene = names["scene"]
    none = pnp_sci.solve(scene.y, scene.masks, prior="none")
    assert pnp_sci.psnr(names["own"].x, scene.truth).mean() > pnp_sci.psnr(none.x, scene.truth).mean() + 2


def test_every_prior_is_in_the_table():
    table = set(re.findall(r"^\| `([\w-]+)` \|", README, re.M))
    assert {*registry.available("priors"), *registry.BUILT_IN["priors"]} <= table
