"""What an import loads, which way imports run, and how much there is in one place."""

import ast
import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = "pnp_sci", "priors", "ofanet_init"
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
    others = ["torch", "safetensors", "matplotlib", "priors.networks", "priors.video", "ofanet_init"]
    assert loaded_after(solve, others) == []


@pytest.mark.parametrize("name", ["ffdnet", "video"])
def test_making_a_network_prior_loads_no_torch(name):
    """Nor does asking for its traits; the first session does."""
    made = f"import pnp_sci; p = pnp_sci.as_prior({name!r}); p.traits((2, 10, 64, 64))"
    assert loaded_after(made, ["torch", "safetensors"]) == []
    pytest.importorskip("torch")
    assert loaded_after(f"{made}; import numpy; p.begin((1, 2, 64, 64), numpy.dtype('f4'))", ["torch"]) == ["torch"]


def test_every_public_name_is_there():
    import pnp_sci

    for name in pnp_sci.__all__:
        assert getattr(pnp_sci, name) is not None


def test_imports_keep_to_the_contracts():
    """Those in pyproject.toml: layers, no circles, and a core that knows no plugin."""
    pytest.importorskip("importlinter")
    lint = "from importlinter.cli import lint_imports; raise SystemExit(lint_imports(no_cache=True))"
    done = subprocess.run(
        [sys.executable, "-c", lint], cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "4 kept, 0 broken" in done.stdout


# ---- what fits on a screen -------------------------------------------------------------------------------------------


def test_a_newcomer_sees_few_modules_at_first():
    modules = sorted(path.name for path in (ROOT / "pnp_sci").glob("*.py"))
    assert len(modules) <= 15, modules


def lengths_of_functions():
    """Lines of signature and body of every function, without decorators and docstring, by file and name."""
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                    first = node.body[0]
                    documented = ast.get_docstring(node) is not None
                    of_text = first.end_lineno - first.lineno + 1 if documented else 0
                    yield f"{path.relative_to(ROOT)}:{node.name}", node.end_lineno - node.lineno + 1 - of_text


def test_functions_fit_on_a_screen():
    long = {name: length for name, length in lengths_of_functions() if length > 60}
    assert not long


def test_the_help_of_solve_fits_on_two_screens():
    import pnp_sci

    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        help(pnp_sci.solve)
    assert "time_budget" in text.getvalue()
    assert len(text.getvalue().splitlines()) <= 70
