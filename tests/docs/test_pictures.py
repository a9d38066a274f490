import re

from tests.docs.pages import DOCS, pages

PICTURES = DOCS / "pictures"
LARGEST = 150_000
"""Bytes: a page of ten pictures loads in a second or two in the field."""


def shown():
    """Pictures of the folder that pages show, by name."""
    found = set()
    for page in pages():
        found |= set(re.findall(r"!\[[^\]]*\]\((?:\.\./)*pictures/([^)\s]+)\)", page.read_text(encoding="utf-8")))
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
    written = set(re.findall(r'path="([^"]+\.(?:svg|png))"', text))
    assert written == set(re.findall(r"\(pictures/([^)]+)\)", text))
