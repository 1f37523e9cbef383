"""What the README and the docs show can be typed."""

import re
import shlex
from pathlib import Path

import pytest

from pnp_sci.cli.main import main
from pnp_sci.results.history import Status

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks(path, language):
    return re.findall(rf"^```{language}\n(.*?)^```$", path.read_text(encoding="utf-8"), re.M | re.S)


def test_the_python_of_the_readme_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = {}
    for code in blocks(ROOT / "README.md", "python"):
        exec(code.replace("embedded_scene()", "embedded_scene(32)"), names)
    assert {path.name for path in tmp_path.iterdir()} == {"views.png", "views.mp4", "result.h5"}


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_commands_have_the_options_that_are_shown(page):
    shown = [line for block in blocks(page, "") for line in re.findall(r"(?:^|&& )pnp-sci (\w.*)$", block, re.M)]
    for line in shown:
        command, *arguments = shlex.split(line, comments=True)
        known = {name for parameter in main.commands[command].params for name in parameter.opts}
        assert {word for word in arguments if word.startswith("--")} <= known, line


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
        if not target.startswith("http"):
            assert (page.parent / target).exists(), target


def test_every_status_and_option_is_in_the_docs():
    results, cli = ((ROOT / "docs" / name).read_text(encoding="utf-8") for name in ("results.md", "cli.md"))
    for status in Status:
        assert f"| `{status.name}` | {status.value} | {'yes' if status.ok else 'no'} |" in results
    for name in main.commands:
        assert f"| `{name}" in cli
