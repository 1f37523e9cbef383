"""What an import loads, and which way imports run."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ["torch", "numba", "scipy", "skimage", "matplotlib", "h5py", "pywt", "imageio", "priors", "ofanet_init"]


def loaded_after(code, names):
    """Which of `names` a fresh interpreter has loaded after `code`."""
    report = f"{code}\nimport json, sys; print(json.dumps([n for n in {names!r} if n in sys.modules]))"
    done = subprocess.run([sys.executable, "-c", report], capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])


def test_importing_the_core_loads_nothing_heavy():
    assert loaded_after("import pnp_sci", HEAVY) == []


def test_the_operator_loads_numba_only_when_it_works():
    make = "import numpy as np, pnp_sci; op = pnp_sci.SensingOperator(np.ones((1, 2, 3, 4)))"
    assert loaded_after(make, ["numba", "torch"]) == []
    assert loaded_after(f"{make}; op.gram", ["numba", "torch"]) == ["numba"]


@pytest.mark.parametrize("prior", ["tv", "wavelet", "none"])
def test_solving_needs_no_torch(prior):
    """Neither the solver nor a classical prior loads torch or what is made of it, though both are installed."""
    solve = (
        "import pnp_sci; s = pnp_sci.datasets.embedded_scene(32)\n"
        f"r = pnp_sci.solve(s.y, s.masks, prior={prior!r}, iterations=3); assert r.x.shape == (2, 10, 32, 32)"
    )
    others = ["torch", "safetensors", "matplotlib", "priors.ffdnet", "priors.video", "ofanet_init"]
    assert loaded_after(solve, others) == []


def test_making_a_learned_prior_loads_no_torch():
    assert loaded_after("from priors.ffdnet import FFDNet; FFDNet()", ["torch"]) == []


def test_every_public_name_is_there():
    import pnp_sci

    for name in pnp_sci.__all__:
        assert getattr(pnp_sci, name) is not None


def test_imports_run_one_way():
    """The contract in pyproject.toml: the core never imports its plugins, and they not each other."""
    pytest.importorskip("importlinter")
    root = Path(__file__).parents[1]
    lint = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    done = subprocess.run(
        [sys.executable, "-c", lint], cwd=root, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "0 broken" in done.stdout
