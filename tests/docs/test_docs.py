"""What the README and the docs show can be typed, links lead somewhere, and no public name is missing."""

import re
import shlex
import sys
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import unquote, urlsplit

import click
import pytest
from click.testing import CliRunner

import pnp_sci
from pnp_sci.cli.main import main
from pnp_sci.plugins import registry

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
GENERATED = ("_build", "gallery", "generated")  # folders that a build makes
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
    *(page for page in sorted(DOCS.rglob("*.md")) if not set(GENERATED) & set(page.relative_to(DOCS).parts)),
]
SIZE = 32  # rows and columns of the embedded scene here
FENCE = re.compile(r"^(?P<fence>```+|~~~+)(?P<info>[^\n`]*)\n(?P<code>.*?)^(?P=fence)[ ]*$", re.M | re.S)


def every(pages):
    return pytest.mark.parametrize("page", pages, ids=lambda page: page.relative_to(ROOT).as_posix())


def blocks(page):
    """Language, whether it is to be run, code and line of each fenced block; directives of MyST are left out."""
    text = page.read_text(encoding="utf-8")
    for found in FENCE.finditer(text):
        language, *marks = found["info"].split() or [""]
        if not language.startswith("{"):
            yield language, "no-run" not in marks, found["code"], text.count("\n", 0, found.start()) + 2


def commands(code):
    """The arguments of each `pnp-sci` command that a block shows, and the lines of other programs."""
    for line in re.sub(r"\\\n\s*", "", code).splitlines():
        for part in line.removeprefix("$ ").split("&&"):
            if re.match(r"(pnp-sci|python) ", part.strip()):
                yield shlex.split(part, comments=True)


def parameters(command):
    """All option names of a command of `pnp-sci`, an error if it does not exist."""
    context = click.Context(main)
    found = main.get_command(context, command)
    assert found is not None, f"there is no command {command}"
    return {name for parameter in found.get_params(context) for name in (*parameter.opts, *parameter.secondary_opts)}


def is_package(module):
    """Whether a module is a package of ours."""
    return module.partition(".")[0] in ("pnp_sci", "priors", "ofanet_init") and bool(
        find_spec(module).submodule_search_locations
    )


PYTHON = [page for page in PAGES if any(language == "python" for language, *_ in blocks(page))]


@every(PYTHON)
def test_blocks_run(page, tmp_path, monkeypatch):
    """All Python of a page, in order; on pages of the tutorials the commands between them too."""
    if page.stem == "fleets":
        pytest.importorskip("zarr")  # which needs Python 3.11
    whole = pnp_sci.datasets.embedded_scene
    monkeypatch.setattr(pnp_sci.datasets, "embedded_scene", lambda size=256: whole(min(size, SIZE)))
    for kind, registered in registry._registered.items():  # a page may register what other tests must not see
        monkeypatch.setitem(registry._registered, kind, dict(registered))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path, str(tmp_path)])
    names = {"__name__": "__main__"}
    for language, run, code, line in blocks(page):
        if language == "python":
            compiled = compile("\n" * (line - 1) + code, str(page), "exec", dont_inherit=True)
            if run:
                exec(compiled, names)
        elif run and language == "console" and page.parent.name == "tutorials":
            for program, *arguments in commands(code):
                assert program == "pnp-sci", f"{page}:{line}: mark what is no command of pnp-sci with no-run"
                done = CliRunner().invoke(main, arguments)
                assert done.exit_code == 0, f"{page}:{line}: {done.output}"


@every(PAGES)
def test_commands_exist(page):
    """Options of `pnp-sci`, and scripts and modules of `python`, are there."""
    for language, _, code, line in blocks(page):
        if language in ("", "console", "text", "sh", "bash", "shell"):
            for program, *arguments in commands(code):
                where = f"{page}:{line}: {program} {shlex.join(arguments)}"
                first, rest = (arguments[0], arguments[1:]) if arguments else ("", [])
                if program == "pnp-sci" and not first.startswith("-"):
                    shown = {word.partition("=")[0] for word in rest if re.match(r"--?[a-z]", word)}
                    assert shown <= parameters(first) | {"--help", "-h"}, where
                elif first == "-m":
                    assert find_spec(rest[0]), where
                    main_of = find_spec(f"{rest[0]}.__main__") if is_package(rest[0]) else None
                    source = Path(main_of.origin).read_text(encoding="utf-8") if main_of else ""
                    options = {word.partition("=")[0] for word in rest[1:] if word.startswith("--")}
                    assert not source or all(f'"{option}"' in source for option in options), where
                elif first.endswith(".py") and not first.isupper() and (ROOT / first).parent != ROOT:
                    assert (ROOT / first).is_file(), where


def anchors(path):
    """The anchors that headings and labels of a page make."""
    text = FENCE.sub("", path.read_text(encoding="utf-8"))
    headings = re.findall(r"^#+ +(.*?)\s*$", text, re.M)
    slugs = (re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings)
    return {*slugs, *re.findall(r"^\(([\w-]+)\)=$", text, re.M), *re.findall(r"\{#([\w-]+)\}", text)}


@every(PAGES)
def test_links_lead_somewhere(page):
    """Files and anchors exist; addresses are well formed. Nothing is looked up in a network."""
    text = FENCE.sub("", page.read_text(encoding="utf-8"))
    text = re.sub(r"`[^`\n]+`", "", text)
    addresses = re.findall(r"<(https?:[^>\s]*)>", text)
    for target in re.findall(r"\]\(<?([^)\s>]+)>?(?: [^)]*)?\)", text):
        if re.match(r"\w+:", target):
            addresses.append(target)
            continue
        path, _, anchor = unquote(target).partition("#")
        there = page.parent / path if path else page
        generated = set(GENERATED) & set(Path(path).parts)  # Sphinx checks these
        assert generated or there.exists() or there.with_suffix(".md").exists(), target
        if anchor and there.suffix == ".md" and not generated and not anchor.startswith("pnp_sci"):
            assert anchor in anchors(there), target
    for address in addresses:
        parts = urlsplit(address)
        assert parts.scheme in ("http", "https", "mailto"), address
        assert parts.scheme == "mailto" or re.fullmatch(r"[\w-]+(\.[\w-]+)+(:\d+)?", parts.netloc), address
        assert not re.search(r"[.,;]$|[\s\"<>]", address), address


def test_every_status_and_command_is_in_the_docs():
    lines = [line for page in PAGES for line in page.read_text(encoding="utf-8").splitlines()]
    for status in pnp_sci.Status:
        assert any(f"`{status.name}`" in line and status.value in line for line in lines), status
    context = click.Context(main)
    for name in main.list_commands(context):
        assert any(re.search(rf"pnp-sci {name}\b|^\| `{name}\b", line) for line in lines), name


def test_every_public_name_is_in_the_reference(tmp_path, monkeypatch):
    """The pages are written from the stub; what Python itself says of the package is the oracle."""
    monkeypatch.syspath_prepend(DOCS / "_ext")
    import reference

    reference.write(tmp_path)
    pages = {path.stem: path.read_text(encoding="utf-8") for path in tmp_path.glob("*.rst")}
    index = (DOCS / "reference" / "index.md").read_text(encoding="utf-8")
    assert all(f"generated/{page}" in index for page in pages)
    shown = "\n".join(pages.values())
    modules = {name for name in pnp_sci.__all__ if type(getattr(pnp_sci, name)) is type(pnp_sci)}
    for name in set(pnp_sci.__all__) - modules:
        assert re.search(rf"^(   |\.\. py:data:: )pnp_sci\.{name}$", shown, re.M), name
    for name in modules:
        assert f"   pnp_sci.{name}." in shown, name
    for name in main.list_commands(click.Context(main)):
        assert f"\npnp-sci {name}\n---" in pages["cli"]
