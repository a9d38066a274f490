"""Pictures on pages: drawn for print they would be small here; and a click shows one by itself, as large as wanted."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from docutils import nodes

if TYPE_CHECKING:
    from sphinx.application import Sphinx

WIDTH = re.compile(rb'<svg[^>]*? width="([\d.]+)pt"')
LARGER = 1.6
"""Pixels of the page for a point of print, where 4/3 is its size on paper: letters of 7 points have 11 pixels."""


def enlarge(app: Sphinx, doctree: nodes.document, name: str) -> None:
    """Say how wide each picture is, never wider than the text; Sphinx makes a link of a picture that is scaled."""
    for image in doctree.findall(nodes.image):
        file = Path(app.srcdir, image["uri"])
        if "width" in image or not file.is_file():
            continue
        found = WIDTH.search(file.read_bytes()[:4000]) if file.suffix == ".svg" else None
        image["width"] = f"{float(found[1]) * LARGER:.0f}px" if found else "100%"


def setup(app: Sphinx) -> dict[str, bool]:
    """When a page is written."""
    app.connect("doctree-resolved", enlarge)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
