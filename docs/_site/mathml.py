"""Formulas as MathML, which browsers draw themselves: no script, no font, no network."""

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.errors import ExtensionError


def mathml(formula: str, *, block: bool) -> str:
    """Return the MathML of a formula in LaTeX, or say which formula docutils cannot translate."""
    try:
        return latex2mathml.tex2mathml(formula.strip(), as_block=block)
    except Exception as error:
        raise ExtensionError(f"formula not understood: {formula.strip()}: {error}") from None


def _visit_math(translator, node: nodes.math) -> None:
    translator.body.append(mathml(node.astext(), block=False))
    raise nodes.SkipNode


def _visit_math_block(translator, node: nodes.math_block) -> None:
    # the box scrolls where a formula is wider than the page
    formula = mathml(node.astext(), block=True)
    translator.body.append(f'<div class="formula" tabindex="0">{formula}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict:
    """Register the renderer for `html_math_renderer`."""
    app.add_html_math_renderer("mathml", (_visit_math, None), (_visit_math_block, None))
    return {"parallel_read_safe": True}
