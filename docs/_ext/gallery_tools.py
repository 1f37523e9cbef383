"""What sphinx-gallery asks for: in which order the examples come, where they write, and which pictures are shown."""

import tempfile
from pathlib import Path

from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

FIRST = ("quickstart", "notebook", "compare_priors", "own_prior", "what_is_modelled")


def order(name):
    """Key to sort the examples by: those of `FIRST`, then the others by name."""
    stem = Path(name).stem
    return (FIRST.index(stem) if stem in FIRST else len(FIRST), stem)


def argv(gallery_conf, script_vars):
    """Options of a script while the site is built: what it writes goes to a temporary folder."""
    return ["--out", tempfile.mkdtemp()]


def scraper(block, block_vars, gallery_conf):
    """Show each figure that a variable of the script names, once: pnp-sci makes figures without pyplot."""
    paths = []
    for value in list(block_vars["example_globals"].values()):
        if isinstance(value, Figure) and not getattr(value, "is_in_gallery", False):
            value.is_in_gallery = True
            path = next(block_vars["image_path_iterator"])
            value.savefig(path, dpi=100)
            paths.append(path)
    plt.close("all")
    return figure_rst(paths, gallery_conf["src_dir"])
