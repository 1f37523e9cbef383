"""How Sphinx builds the site: ``sphinx-build -W --keep-going -b html docs docs/_build/html``, without a network."""

import sys
from importlib.metadata import version as installed_version
from pathlib import Path

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS / "_ext"))

project = "pnp-sci"
author = "the pnp-sci authors"
release = version = installed_version("pnp-sci")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
    "numpydoc",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
    "sphinx_design",
    "mathml",  # docs/_ext
    "reference",  # docs/_ext
]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}
exclude_patterns = ["_build", "_ext", "_templates", "gallery/*.md5"]
templates_path = ["_templates"]

html_theme = "furo"
html_title = f"pnp-sci {release}"
html_static_path = ["_static"]
html_css_files = ["pnp-sci.css"]
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}
copybutton_prompt_text = "$ "

myst_enable_extensions = ["amsmath", "attrs_inline", "colon_fence", "deflist", "dollarmath", "fieldlist"]
myst_heading_anchors = 4  # a link page.md#heading is checked

# A link to an object of pnp-sci that is not in the reference is an error. Links to other packages would need a network.
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!pnp_sci\b).*"),
    ("py:.*", r"pnp_sci\.\w+\.\w+\..*"),  # internals
    ("py:mod", ".*"),
]
autodoc_typehints = "none"  # the docstrings have the types, with shapes
autodoc_class_signature = "mixed"
autodoc_member_order = "bysource"
autosummary_generate = True
numpydoc_show_class_members = False  # the template of a class lists them
numpydoc_class_members_toctree = False

sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": r"[/\\](?!replay_real)\w+\.py$",  # the captures have to be downloaded: shown, not run
    "within_subsection_order": "gallery_tools.order",
    "image_scrapers": ("gallery_tools.scraper",),
    "reset_argv": "gallery_tools.argv",
    "download_all_examples": False,
    "ignore_repr_types": r"[Ff]igure",  # the scraper shows them
    "show_memory": False,
    "show_signature": False,
    "remove_config_comments": True,
    "plot_gallery": True,
    "write_computation_times": False,
    "backreferences_dir": None,
}
