"""Writes the pages of the reference from what is there: the stub, the entry points, the commands.

No list of names is kept by hand. A name that is added to ``pnp_sci/__init__.pyi`` appears by itself, on the page of the
topic that the folder or module it is imported from belongs to.
"""

import ast
import importlib
import inspect
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path

TOPICS = {  # page: heading, and the folders and modules of pnp_sci whose names it shows
    "solve": ("Solve and results", {"api", "pipeline", "results", "solvers", "scene", "errors", "fleet"}),
    "operator": ("Operator and camera", {"sensing", "camera"}),
    "data": ("Masks and data", {"masks", "datasets", "io", "formats"}),
    "priors": ("Priors and decoders", set()),
    "plugins": ("Plugins and testing", {"plugins", "testing"}),
    "measuring": ("Measuring and advice", {"metrics", "plot", "advice", "bench"}),  # and all that no other page takes
}
BESIDE_THE_STUB = ("errors", "testing", "bench")  # public modules that are not among the names of pnp_sci
GROUPS = ("pnp_sci.priors", "pnp_sci.decoders")


def stub():
    """The names of the stub, each with the path of the module that it comes from ("" if it is defined there)."""
    text = Path(find_spec("pnp_sci").origin).with_suffix(".pyi").read_text(encoding="utf-8")
    names = {}
    for node in ast.parse(text).body:
        if isinstance(node, ast.ImportFrom):
            for alias in node.names:
                module = node.module or ""
                if node.level:
                    module = f"pnp_sci.{module}".rstrip(".")
                names[alias.asname or alias.name] = module.removeprefix("pnp_sci").lstrip(".") or alias.name
        elif isinstance(node, ast.AnnAssign):
            names[node.target.id] = ""
        elif isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names[node.name] = ""
    return names


def members(module_name):
    """Public functions and classes of a module, by their full names."""
    module = importlib.import_module(module_name)
    names = getattr(module, "__all__", None) or [
        name
        for name, thing in vars(module).items()
        if not name.startswith("_")
        and (inspect.isfunction(thing) or inspect.isclass(thing))
        and thing.__module__ == module_name
    ]
    return [f"{module_name}.{name}" for name in names]


def plugins():
    """What the entry points name: priors and decoders of this distribution, by their full names."""
    points = [point for group in GROUPS for point in entry_points(group=group) if point.dist.name == "pnp-sci"]
    return sorted({f"{point.module}.{point.attr}" for point in points})


def topics():
    """For each page the full names on it, in the order of the stub."""
    pages = {page: [] for page in TOPICS}
    for name, module in stub().items():
        head = module.partition(".")[0]
        page = next((page for page, (_, heads) in TOPICS.items() if head in heads), "measuring")
        pages[page] += members(f"pnp_sci.{name}") if head == name else [f"pnp_sci.{name}"]
    for name in BESIDE_THE_STUB:
        page = next(page for page, (_, heads) in TOPICS.items() if name in heads)
        pages[page] += [full for full in members(f"pnp_sci.{name}") if full not in pages[page]]
    pages["priors"] += plugins()
    return pages


def page_of(heading, names):
    """One page of the reference: a table of names, each with a page of its own."""
    plain = [name for name in names if name.rpartition(".")[2].startswith("__")]
    lines = [heading, "=" * len(heading), ""]
    for name in plain:
        value = getattr(importlib.import_module("pnp_sci"), name.rpartition(".")[2])
        lines += [f".. py:data:: {name}", "", f"   A {type(value).__name__}, here ``{value!r}``.", ""]
    lines += [".. autosummary::", "   :toctree: api", "   :nosignatures:", ""]
    return "\n".join([*lines, *(f"   {name}" for name in names if name not in plain), ""])


def commands():
    """The page of the command line, from the help texts of click."""
    import click

    from pnp_sci.cli.main import main

    parent = click.Context(main, info_name="pnp-sci", max_content_width=100, terminal_width=100)
    lines = ["Command line", "============", "", "``python -m pnp_sci`` is the same command.", ""]
    for name in ("", *main.list_commands(parent)):
        command = main.get_command(parent, name) if name else main
        context = click.Context(command, info_name=name, parent=parent, terminal_width=100) if name else parent
        title = f"pnp-sci {name}".strip()
        text = command.get_help(context)
        lines += [title, "-" * len(title), "", ".. code-block:: text", ""]
        lines += [f"   {line}".rstrip() for line in text.splitlines()] + [""]
    return "\n".join(lines)


def write(folder):
    """Write all pages to a folder; a page that has not changed keeps its time stamp, and is not built again."""
    folder.mkdir(parents=True, exist_ok=True)
    pages = {page: page_of(TOPICS[page][0], names) for page, names in topics().items()}
    for page, text in {**pages, "cli": commands()}.items():
        path = folder / f"{page}.rst"
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def aliases():
    """For each name by which docstrings may call a public object, the name that it has in the reference."""
    known = {}
    for name in (name for names in topics().values() for name in names):
        module, _, attribute = name.rpartition(".")
        thing = getattr(importlib.import_module(module), attribute)
        known[f"{getattr(thing, '__module__', module)}.{attribute}"] = name
        known[f"pnp_sci.{getattr(thing, '__module__', '').rpartition('.')[2]}.{attribute}"] = name
    return known


def resolve(app, env, node, contnode):
    """Resolve a link to a public object that is called by the module it is defined in."""
    target = app.pnp_sci_aliases.get(node.get("reftarget"))
    if node.get("refdomain") != "py" or target is None:
        return None
    domain = env.get_domain("py")
    return domain.resolve_xref(env, node["refdoc"], app.builder, node["reftype"], target, node, contnode)


def calibration(app, docname, source):
    """Add the tables that have been generated to the page that says how, maybe none."""
    if docname == "calibration/index":
        tables = sorted(path.stem for path in (Path(app.srcdir) / "calibration").glob("*.md") if path.stem != "index")
        if tables:
            source[0] += "\n".join(["\n```{toctree}", ":maxdepth: 1", "", *tables, "```", ""])


def setup(app):
    """Tell Sphinx to write the pages before it looks for them."""
    app.pnp_sci_aliases = aliases()
    app.connect("missing-reference", resolve)
    app.connect("source-read", calibration)
    app.connect("config-inited", lambda app, config: write(Path(app.srcdir) / "reference" / "generated"), priority=100)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
