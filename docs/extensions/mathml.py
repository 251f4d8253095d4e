r"""Formulas as MathML, which browsers draw without scripts and without a network.

The converter is that of docutils. A formula that it cannot convert is an error of the build.
"""

import re

from docutils import nodes
from docutils.utils.math import MathError, latex2mathml
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

_logger = logging.getLogger(__name__)
_REPLACED = {"°": r"^\circ", r"\tfrac": r"\frac"}
# Corrections of the converter: accents written as limits, and missing or additional spaces.
_CORRECTIONS = (
    (
        r'<munderover>\s*(<mi>.</mi>)\s*((?:(?!<munderover>).)+?)\s*(<mo stretchy="false">ˆ</mo>)'
        r"\s*</munderover>",
        r'<msub><mover accent="true">\1\3</mover>\2</msub>',
    ),
    (
        r"<mo>&ApplyFunction;</mo>(?!\s*<mo[^>]*>\()",
        '<mo>&ApplyFunction;</mo><mspace width="0.1667em"></mspace>',
    ),
    (r"<mo([^>]*)>\|</mo>", r'<mo\1 lspace="0" rspace="0">|</mo>'),
)
_BARE_FRACTION = re.compile(r"\\frac(\d)(\d)")


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", (_inline, None), (_displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _inline(writer: HTML5Translator, node: nodes.math) -> None:
    writer.body.append(_mathml(node.astext(), node, displayed=False))
    raise nodes.SkipNode


def _displayed(writer: HTML5Translator, node: nodes.math_block) -> None:
    writer.body.append(writer.starttag(node, "div", CLASS="formula"))
    writer.body.append(_mathml(node.astext(), node, displayed=True))
    if node["number"]:
        number = get_node_equation_number(writer, node)
        writer.body.append(f'<span class="eqno">({number})</span>')
    writer.body.append("</div>\n")
    raise nodes.SkipNode


def _mathml(tex: str, node: nodes.Element, *, displayed: bool) -> str:
    try:
        return converted(tex, displayed=displayed)
    except MathError as error:
        _logger.warning("formula not understood: %s: %s", tex, error, location=node)
        return ""


def converted(tex: str, *, displayed: bool) -> str:
    """A formula as MathML.

    Raises
    ------
    MathError
        If the formula has something that the converter does not know.
    """
    for known_to_tex, known_to_docutils in _REPLACED.items():
        tex = tex.replace(known_to_tex, known_to_docutils)
    tex = _BARE_FRACTION.sub(r"\\frac{\1}{\2}", tex)
    drawn = str(latex2mathml.tex2mathml(tex, as_block=displayed))
    for written, better in _CORRECTIONS:
        drawn = re.sub(written, better, drawn, flags=re.DOTALL)
    return drawn
