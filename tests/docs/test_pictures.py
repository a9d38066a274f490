import re
from importlib import import_module
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from gmwm.showing.plots import style
from tests.docs.pages import DOCS, pages

PICTURES = DOCS / "pictures"
LARGEST = 150_000
"""Bytes: a page of ten pictures loads in a second or two in the field."""


def shown():
    """Pictures of the folder that pages show, by name."""
    found = set()
    for page in pages():
        text = page.read_text(encoding="utf-8")
        found |= set(re.findall(r"(?:!\[[^\]]*\]\(|^```\{image\} )(?:\.\./)*pictures/([^)\s]+)", text, re.MULTILINE))
    return found


def made():
    """Pictures in the folder."""
    return {file.name: file.stat().st_size for file in PICTURES.iterdir() if file.suffix in (".svg", ".png")}


def test_pictures_are_those_that_pages_show():
    assert shown() == set(made())


def test_pictures_are_small():
    assert {name: size for name, size in made().items() if size > LARGEST} == {}


def test_pictures_of_the_gallery_are_written_by_the_blocks_above_them():
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    written = set(re.findall(r'(?:path=|savefig\()"([^"]+\.(?:svg|png))"', text))
    assert written == set(re.findall(r"\(pictures/([^)]+)\)", text))


@pytest.mark.parametrize(("uri", "width"), [("pictures/fit.svg", "544px"), ("pictures/track.png", "100%")])
def test_pictures_are_larger_on_pages_than_in_print(uri, width, monkeypatch):
    nodes = pytest.importorskip("docutils.nodes", reason="needs Sphinx: pip install '.[docs]'")
    monkeypatch.syspath_prepend(str(DOCS))
    enlarge = __import__("_site.pictures", fromlist=["enlarge"]).enlarge
    document, image = nodes.section(), nodes.image(uri=uri)
    document += image
    enlarge(SimpleNamespace(srcdir=str(DOCS)), document, "gallery")
    assert image["width"] == width


def test_pictures_that_have_a_width_keep_it(monkeypatch):
    nodes = pytest.importorskip("docutils.nodes", reason="needs Sphinx: pip install '.[docs]'")
    monkeypatch.syspath_prepend(str(DOCS))
    enlarge = __import__("_site.pictures", fromlist=["enlarge"]).enlarge
    document = nodes.section()
    document += [nodes.image(uri="pictures/fit.svg", width="3em"), nodes.image(uri="https://example.org/a.png")]
    enlarge(SimpleNamespace(srcdir=str(DOCS)), document, "gallery")
    assert [image.get("width") for image in document] == ["3em", None]


# --- the dark scheme ----------------------------------------------------------------------------------


@pytest.fixture
def site_extension(monkeypatch):
    pytest.importorskip("docutils.nodes", reason="needs Sphinx: pip install '.[docs]'")
    monkeypatch.syspath_prepend(str(DOCS))
    return lambda name: import_module(f"_site.{name}")


def luminance(rgb):
    """Relative luminance (WCAG 2) of a colour from 0 to 1."""
    linear = np.where(rgb <= 0.03928, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def rgb_of(colour):
    return np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255


def test_white_becomes_the_dark_page_and_lines_stand_out_from_it(site_extension):
    dark = site_extension("dark").dark
    page = dark(rgb_of("#ffffff"))
    assert np.abs(page - rgb_of("#131416")).max() < 2 / 255
    strokes = (
        style.BLACK,
        style.ORANGE,
        style.SKY,
        style.GREEN,
        style.BLUE,
        style.VERMILLION,
        style.PURPLE,
        style.GREY,
    )
    contrast = {stroke: (luminance(dark(rgb_of(stroke))) + 0.05) / (luminance(page) + 0.05) for stroke in strokes}
    assert min(contrast.values()) > 3.5, contrast
    assert contrast[style.BLACK] > 12


def test_what_names_no_colour_in_a_drawing_is_light_in_the_dark(site_extension):
    text = site_extension("dark").dark_svg('<svg width="9"><path d="M 0 0"/><path style="stroke: #FFFFFF"/></svg>')
    assert re.match(r'<svg fill="#e[0-9a-f]{5}" width', text)
    assert "#FFFFFF" not in text


def test_a_picture_of_a_page_has_two_versions(site_extension):
    both = site_extension("pictures").for_both_schemes
    body = '<p><a href="_images/fit.svg"><img alt="A fit" src="_images/fit.svg" style="width: 544px;" /></a></p>'
    body = both(body, {"fit.svg": PICTURES / "fit.svg"})
    assert body.count("<img ") == 2
    assert 'class="only-light"' in body
    assert 'src="_images/dark-fit.svg"' in body
    assert body.count("aspect-ratio: ") == 2


def test_the_logo_is_drawn_by_code():
    logo = pytest.importorskip("docs.pictures.logo")
    assert (logo.STATIC / "logo.svg").read_text(encoding="utf-8") == logo.drawing(4, True)
    assert (logo.STATIC / "icon.svg").read_text(encoding="utf-8") == logo.drawing(8, False)
    with Image.open(logo.STATIC / "card.png") as card:
        assert card.size == (1200, 630)
