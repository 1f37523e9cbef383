"""Formulas as MathML, which browsers show by themselves: no script and no font is loaded from elsewhere."""

import re

from docutils import nodes
from latex2mathml.commands import MATRICES
from latex2mathml.converter import convert
from sphinx.util import logging

log = logging.getLogger(__name__)

ENVIRONMENTS = {name.removeprefix("\\") for name in MATRICES}
INSTEAD = {  # what LaTeX has and the converter has not, or numbers by itself
    r"\\arg(?![a-z])": r"\\operatorname{arg}",
    r"\{aligned\}": r"{split}",
    r"\{align\}": r"{align*}",
}


def mathml(node, **options):
    """Convert a formula; what cannot be shown is a warning."""
    text = node.astext()
    for pattern, replacement in INSTEAD.items():
        text = re.sub(pattern, replacement, text)
    if r"\\" in text and r"\begin" not in text:  # lines, as Sphinx has them
        text = rf"\begin{{split}}{text}\end{{split}}"
    out = convert(text, **options)
    for lost in re.findall(r"<m[ino][^>]*>(\\\w+|&)<", out):
        log.warning("the formula has %s, which cannot be shown", lost, location=node)
    for environment in set(re.findall(r"\\begin\{(\w+\*?)\}", text)) - ENVIRONMENTS:
        log.warning("the formula has an environment %s, which cannot be shown", environment, location=node)
    return out


def inline(self, node):
    """Write a formula within a sentence."""
    self.body.append(mathml(node))
    raise nodes.SkipNode


def display(self, node):
    """Write a formula that stands alone, with its number if it has one."""
    number = node.get("number")
    self.body.append(self.starttag(node, "div", CLASS="math-display"))
    self.body.append(mathml(node, display="block"))
    if number is not None:
        self.body.append(f'<span class="math-number">({number})</span>')
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app):
    """Tell Sphinx of the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    app.config.html_math_renderer = "mathml"
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
