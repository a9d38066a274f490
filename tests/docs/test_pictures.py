import re
from types import SimpleNamespace

import pytest

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
