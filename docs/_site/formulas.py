"""Formulas as pictures of their letters, set by Matplotlib when the site is built: pages need no script."""

from __future__ import annotations

import html
import re
from functools import cache
from typing import TYPE_CHECKING, Any

from docutils import nodes
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path
from matplotlib.textpath import TextPath, text_to_path
from sphinx.util import logging

if TYPE_CHECKING:
    from sphinx.application import Sphinx

logger = logging.getLogger(__name__)

UNITS = 100.0
"""Of the picture, in an em."""
EM = 1.1
"""Of the text around a formula: its letters, without serifs, are as high at a tenth less."""
SMALLEST = 0.85
"""Of a formula of its own, as a share of what it is where there is room."""
FONT = FontProperties(size=UNITS, math_fontfamily="stix")  # type: ignore[arg-type]
# What authors are used to, in the words that Matplotlib knows.
SPELLINGS = (
    (re.compile(r"\\lvert\b"), r"|\\hspace{0.08}"),
    (re.compile(r"\\rvert\b"), r"\\hspace{0.12}|"),
    (re.compile(r"\\tfrac\b"), r"\\frac"),
    (re.compile(r"\\dots\b"), r"\\ldots"),
    (re.compile(r"\\(le|ge)\b"), r"\\\1q"),
    (re.compile(r"\\(?:mathsf|mathrm) *([a-zA-Z])"), r"\\mathrm{\1}"),
    (re.compile(r"\\mathsf\b"), r"\\mathrm"),
    (re.compile(r"(?<=[a-zA-Z0-9)])\\(sinh?|cosh?|ln|log|exp)\b"), r"\\,\\\1"),
    (re.compile(r"\\sqrt +(\w|\\[a-zA-Z]+)"), r"\\sqrt{\1}"),
    (re.compile(r"\\argmin(?![a-zA-Z])"), r"\\arg\\min"),
)
LIMITS = r"(?:_(?:\{[^{}]*\}|\\?\w+))?(?:\^(?:\{[^{}]*\}|\\?\w+))?"
OPENING, CLOSING = re.compile(r"[(\[]+\Z"), re.compile(r"\A[,.;:)\]]+")
SUM = re.compile(rf"\\sum({LIMITS})")
"""A sum and its limits, in braces or a letter."""


@cache
def as_svg(formula: str, block: bool) -> str:
    """The formula as SVG in the colour of the text around it, on its line, 1 em high letters."""
    text = " ".join(formula.split())
    for found, spelt in SPELLINGS:
        text = found.sub(spelt, text)
    # Limits stand under a sum where there is room for them, beside it in a line; either way it keeps its distance.
    text = SUM.sub(r"\,\\sum\1\," if block else r"{\\sum}\1\,", text)
    if block:
        text = text.replace(r"\frac", r"\dfrac")
    text = f"${text}$"
    width, whole, depth = text_to_path.mathtext_parser.parse(text, text_to_path.DPI, FONT)[:3]
    drawn = _outline(TextPath((0, 0), text, size=UNITS, prop=FONT))
    left, top, wide, high = -5, depth - whole - 5, width + 10, whole + 10
    box = f"{left} {top:.0f} {wide:.0f} {high:.0f}"
    em = EM / UNITS
    if block:
        # On a narrow page it becomes a little smaller before it has to be scrolled.
        size = f"width:clamp({SMALLEST * wide * em:.2f}em,100%,{wide * em:.2f}em);height:auto"
    else:
        size = f"width:{wide * em:.2f}em;height:{high * em:.2f}em"
    # An f leans out of its box, which is what is set beside the next letter, and is not cut there.
    style = f"{size};vertical-align:{-(depth + 5) * em:.2f}em;overflow:visible"
    words = html.escape(formula)
    return (
        f'<svg class="formula" role="img" aria-label="{words}" viewBox="{box}" style="{style}">'
        f'<title>{words}</title><path d="{drawn}"/></svg>'
    )


def _outline(path: Path) -> str:
    """A path in the letters of SVG, whose y points down."""
    letters = {Path.MOVETO: "M", Path.LINETO: "L", Path.CURVE3: "Q", Path.CURVE4: "C", Path.CLOSEPOLY: "Z"}
    parts = []
    for vertices, code in path.iter_segments(curves=True, simplify=False):
        points = vertices.reshape(-1, 2) if code != Path.CLOSEPOLY else ()
        parts.append(letters[code] + " ".join(f"{x:.1f} {-y:.1f}" for x, y in points))
    return "".join(parts)


def written(node: nodes.Element, block: bool) -> str:
    """The formula of a node; one that is not understood is a warning, and stays as it was typed."""
    try:
        return as_svg(node.astext(), block)
    except ValueError as error:
        logger.warning("formula not understood: %s: %s", node.astext(), str(error).splitlines()[-1], location=node)
        return f"<code>{html.escape(node.astext())}</code>"


def held(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Give each formula in a line the marks that it must not be parted from: a line could end between the two."""
    for node in list(doctree.findall(nodes.math)):
        at = node.parent.index(node)
        before, after = (node.parent[k] if 0 <= k < len(node.parent) else None for k in (at - 1, at + 1))
        for other, mark, end in ((before, OPENING, "before"), (after, CLOSING, "after")):
            found = mark.search(other.astext()) if isinstance(other, nodes.Text) else None
            if found and other is not None:
                node[end] = found[0]
                node.parent.replace(other, nodes.Text(mark.sub("", other.astext())))


def inline(translator: Any, node: nodes.Element) -> None:
    """Write a formula in a line."""
    before, after = (html.escape(node.get(end, "")) for end in ("before", "after"))
    picture = written(node, block=False)
    if before or after:
        picture = f'<span style="white-space:nowrap">{before}{picture}{after}</span>'
    translator.body.append(picture)
    raise nodes.SkipNode


def block(translator: Any, node: nodes.Element) -> None:
    """Write a formula of its own, which scrolls where it is wider than the page; its label is a target of links."""
    label = f' id="equation-{node["label"]}"' if node.get("label") else ""
    number = f'<span class="eqno">({node["number"]})</span>' if node.get("number") else ""
    translator.body.append(f'<div class="math formula"{label}>{number}{written(node, block=True)}</div>')
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Offer the renderer by the name "outlines"."""
    app.add_html_math_renderer("outlines", (inline, None), (block, None))
    app.connect("doctree-resolved", held)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
