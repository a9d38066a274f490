"""Formulas of the site are drawn whole, no higher than they are, on their line, and are told to who cannot see them."""

import re
import sys
from types import SimpleNamespace

import pytest
from docutils import nodes

from tests.docs.pages import DOCS, pages

sys.path.insert(0, str(DOCS))
from _site.formulas import EM, UNITS, as_svg, held, inline

CODE = re.compile(r"```.*?```|`[^`\n]*`", re.DOTALL)
BOX, ALIGN = re.compile(r'viewBox="([^"]+)"'), re.compile(r"vertical-align:(-?[\d.]+)em")
POINT = re.compile(r"(-?[\d.]+) (-?[\d.]+)")


def formulas():
    """Every formula of the pages, and whether it has a line of its own."""
    found = set()
    for page in pages():
        text = CODE.sub("", page.read_text(encoding="utf-8"))
        found |= {(formula, True) for formula in re.findall(r"\$\$(.+?)\$\$", text, re.DOTALL)}
        text = re.sub(r"\$\$(.+?)\$\$", "", text, flags=re.DOTALL)
        found |= {(formula, False) for formula in re.findall(r"\$([^$\n]+?)\$", text)}
    return sorted(found)


def box_and_ink(svg):
    """Left, top, right and bottom of the picture, and of what is drawn in it, in its units."""
    left, top, width, height = map(float, BOX.search(svg)[1].split())
    points = [(float(x), float(y)) for x, y in POINT.findall(re.search(r'd="([^"]*)"', svg)[1])]
    xs, ys = zip(*points, strict=True)
    return (left, top, left + width, top + height), (min(xs), min(ys), max(xs), max(ys))


def test_there_are_formulas():
    assert len(formulas()) > 60


@pytest.mark.slow
def test_a_picture_is_as_large_as_its_formula():
    for formula, block in formulas()[::3]:
        box, ink = box_and_ink(as_svg(formula, block))
        # Letters may lean out at the sides, and are not cut there.
        assert box[0] - UNITS / 8 <= ink[0] < ink[2] <= box[2] + UNITS / 8, formula
        assert box[1] <= ink[1] < ink[3] <= box[3], formula
        # Half an em is left above a formula of low letters, no more: lines stay where they are.
        assert ink[1] - box[1] < UNITS / 2, formula
        assert box[3] - ink[3] < UNITS / 2, formula


def test_letters_that_lean_out_are_not_cut():
    svg = as_svg("f", block=False)
    box, ink = box_and_ink(svg)
    assert ink[0] < box[0]
    assert ink[2] > box[2]
    assert "overflow:visible" in svg


def test_a_picture_stands_on_the_line_of_the_text():
    for formula in ("x", "y_j", r"\frac{1}{2}", r"\sum_{k=1}^{N} k"):
        svg = as_svg(formula, block=False)
        shift = float(ALIGN.search(svg)[1])
        assert shift == pytest.approx(-box_and_ink(svg)[0][3] * EM / UNITS, abs=0.011)


def test_limits_of_a_sum_are_beside_it_in_a_line_and_under_it_elsewhere():
    inline, own = (box_and_ink(as_svg(r"\sum_{k=1}^{N} k", block))[1] for block in (False, True))
    assert inline[3] - inline[1] < own[3] - own[1]


def test_formulas_are_told_as_they_are_typed():
    assert 'aria-label="a &lt; b"' in as_svg("a < b", block=False)


@pytest.mark.parametrize(("typed", "drawn"), [(r"\argmin_x f", r"\arg\min_x f"), (r"a \le b", r"a \leq b")])
def test_what_authors_are_used_to_is_drawn(typed, drawn):
    def picture(formula):
        return re.search(r'd="([^"]*)"', as_svg(formula, block=True))[1]

    assert picture(typed) == picture(drawn)


def test_what_is_not_understood_is_an_error():
    with pytest.raises(ValueError, match="nosuchthing"):
        as_svg(r"\nosuchthing", block=False)


def test_marks_stay_with_their_formula():
    line = nodes.paragraph()
    line += [nodes.Text("see ("), nodes.math("", "x"), nodes.Text("), or "), nodes.math("", "y"), nodes.Text(" it")]
    held(None, line, "theory")
    assert [part.astext() for part in line] == ["see ", "x", " or ", "y", " it"]
    written = SimpleNamespace(body=[])
    for node in (line[1], line[3]):
        with pytest.raises(nodes.SkipNode):
            inline(written, node)
    assert re.fullmatch(r'<span style="white-space:nowrap">\(<svg.*</svg>\),</span>', written.body[0])
    assert written.body[1].startswith("<svg")
