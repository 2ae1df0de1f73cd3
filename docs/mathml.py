"""A Sphinx extension that writes formulas as MathML, which browsers draw themselves: no script, no
font, no network.
"""

from xml.etree import ElementTree

from docutils import nodes
from latex2mathml.converter import convert
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.writers.html5 import HTML5Translator

logger = logging.getLogger(__name__)


def mathml(node: nodes.math | nodes.math_block, display: str) -> str:
    formula = node.astext().replace("{aligned}", "{align*}")  # the converter knows only the latter
    result = convert(formula, display=display)
    try:
        ElementTree.fromstring(result)
    except ElementTree.ParseError:
        logger.warning("formula cannot be converted to MathML: %s", formula, location=node)
    return str(result)


def inline(translator: HTML5Translator, node: nodes.math) -> None:
    translator.body.append(mathml(node, "inline"))
    raise nodes.SkipNode


def block(translator: HTML5Translator, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{mathml(node, "block")}</div>\n')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_html_math_renderer("mathml", (inline, None), (block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
