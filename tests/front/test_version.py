"""One version, in every place that tells it."""

import re
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

import pnp_sci

ROOT = Path(__file__).parents[2]


def test_the_version_is_that_of_the_installed_package():
    assert pnp_sci.__version__ == version("pnp-sci")


def test_the_version_is_read_when_it_is_asked_for():
    code = "import sys, pnp_sci; print('importlib.metadata' in sys.modules)"
    done = subprocess.run([sys.executable, "-S", "-c", f"import sys; sys.path[:] = {sys.path!r}; {code}"],
                          capture_output=True, text=True)  # fmt: skip
    assert done.stdout == "False\n", done.stderr


def test_files_tell_the_same_version():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    cited = re.search(r"^version: (\S+)$", (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert cited
    assert cited[1] == project["version"]
    assert f"## [{project['version']}] - 20" in changes
    assert "## [Unreleased]" in changes


def test_classifiers_and_the_workflow_name_the_same_versions_of_python():
    tomllib = pytest.importorskip("tomllib", reason="Python 3.10 reads no TOML")
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    named = [line.split(" :: ")[-1] for line in project["classifiers"] if re.search(r":: 3\.\d+$", line)]
    workflow = (ROOT / ".github" / "workflows" / "tests.yml").read_text(encoding="utf-8")
    (matrix,) = re.findall(r"python: \[(.+)\]", workflow)
    assert re.findall(r'"([\d.]+)"', matrix) == named
    assert project["requires-python"] == f">={named[0]}"
