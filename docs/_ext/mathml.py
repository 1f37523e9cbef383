"""Formulas as MathML, which browsers show by themselves: no script and no font is loaded from elsewhere."""

from docutils import nodes
from latex2mathml.converter import convert


def inline(self, node):
    """Write a formula within a sentence."""
    self.body.append(convert(node.astext()))
    raise nodes.SkipNode


def display(self, node):
    """Write a formula that stands alone, with its number if it has one."""
    number = node.get("number")
    self.body.append(self.starttag(node, "div", CLASS="math-display"))
    self.body.append(convert(node.astext(), display="block"))
    if number is not None:
        self.body.append(f'<span class="math-number">({number})</span>')
    self.body.append("</div>\n")
    raise nodes.SkipNode


def setup(app):
    """Tell Sphinx of the renderer."""
    app.add_html_math_renderer("mathml", (inline, None), (display, None))
    app.config.html_math_renderer = "mathml"
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
