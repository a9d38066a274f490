"""Pictures on pages: larger than in print, in a version for each colour scheme, and alone at a click."""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from docutils import nodes
from PIL import Image

from _site.dark import write_dark

if TYPE_CHECKING:
    from sphinx.application import Sphinx

SIZE = re.compile(rb'<svg[^>]*? width="([\d.]+)pt" height="([\d.]+)pt"')
LARGER = 1.6
"""Pixels of the page for a point of print, where 4/3 is its size on paper: letters of 7 points have 11 pixels."""

SHOWN = re.compile(
    r'<img (?P<rest>[^>]*?)src="(?P<folder>(?:\.\./)*_images/)(?P<name>[^"/]+\.(?:svg|png))"(?P<end>[^>]*)>'
)
CLASS = re.compile(r' ?class="([^"]*)"')


def enlarge(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Say how wide each picture is, never wider than the text; Sphinx makes a link of a picture that is scaled."""
    for image in doctree.findall(nodes.image):
        file = Path(app.srcdir, image["uri"])
        if "width" in image or not file.is_file():
            continue
        width, _ = size(file)
        image["width"] = f"{width * LARGER:.0f}px" if file.suffix == ".svg" and width else "100%"


def size(file: Path) -> tuple[float, float]:
    """Width and height of a picture, in points (.svg) or pixels; zeros if a drawing does not state them."""
    if file.suffix == ".svg":
        match = SIZE.search(file.read_bytes()[:4000])
        return (float(match[1]), float(match[2])) if match else (0.0, 0.0)
    with Image.open(file) as picture:
        return picture.size


def for_both_schemes(body: str, files: Mapping[str, Path]) -> str:
    """The page with two versions of each picture. The theme hides the one that does not belong to its scheme.

    A browser loads a picture when it is scrolled into view, and keeps its place by the ratio of its sides.
    """

    def both(match: re.Match[str]) -> str:
        attributes = f"{match['rest']}{match['end'].rstrip('/ ')}"
        classes = CLASS.search(attributes)
        attributes = CLASS.sub("", attributes).strip()
        width, height = size(files[match["name"]])
        if width and 'style="' in attributes:
            attributes = attributes.replace('style="', f'style="aspect-ratio: {width:g} / {height:g}; ')
        return "".join(
            f'<img class="{classes[1] + " " if classes else ""}only-{scheme}" {attributes} '
            f'loading="lazy" src="{match["folder"]}{prefix}{match["name"]}">'
            for scheme, prefix in (("light", ""), ("dark", "dark-"))
        )

    return SHOWN.sub(both, body)


def show_both(app: Sphinx, page: str, template: str, context: dict[str, object], doctree: object) -> None:
    """Put both versions on a page."""
    if isinstance(body := context.get("body"), str):
        files = {name: Path(app.srcdir, path) for path, name in app.builder.images.items()}
        context["body"] = for_both_schemes(body, files)


def darken(app: Sphinx, failure: Exception | None) -> None:
    """Write the dark version of every picture of the site."""
    for file in [] if failure else sorted(Path(app.outdir, "_images").glob("*.*")):
        if file.suffix in (".svg", ".png") and not file.name.startswith("dark-"):
            write_dark(file, file.with_name(f"dark-{file.name}"))


def setup(app: Sphinx) -> dict[str, bool]:
    """When a page is written, and when all are."""
    app.connect("doctree-resolved", enlarge)
    app.connect("html-page-context", show_both)
    app.connect("build-finished", darken)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
