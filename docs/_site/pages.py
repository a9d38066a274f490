"""Pages that GitHub's readers see too: links to files beside docs/, and the titles of studies."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGES = {
    "README.md": "index",
    "CONTRIBUTING.md": "contributing",
    "CHANGELOG.md": "changelog",
    "docs/README.md": "index",
}
"""Files of the repository, and the page that says the same."""

SECTIONS = {"README.md#what-the-numbers-mean": "numbers"}
"""Sections that are pages of their own here."""

STUDIES = Path(__file__).parents[2] / "validation"

LINK = re.compile(r"(?<!!)\[([^\]]+)\]\(((?:\.\./)+)([^)#\s]+)((?:#[^)\s]*)?)\)")


def mend(app: Sphinx, name: str, source: list[str]) -> None:
    """Lead links out of docs/ to the site's page of that file; of a file that has none, leave its path."""
    depth = name.count("/") + 1

    def mended(found: re.Match[str]) -> str:
        words, up, path, place = found.groups()
        if up.count("../") != depth:
            return found[0]
        if path + place in SECTIONS:
            return f"[{words}](/{SECTIONS[path + place]}.md)"
        if path in PAGES:
            return f"[{words}](/{PAGES[path]}.md{place if PAGES[path] != 'index' else ''})"
        return words if path in words else f"{words} (`{path}`)"

    source[0] = LINK.sub(mended, source[0])


def entitle(app: Sphinx, name: str, source: list[str]) -> None:
    """Give the table of a study, which has no title of its own, the question that the study asks."""
    folder, _, study = name.rpartition("/")
    if folder == "validation" and not source[0].startswith("# "):
        code = (STUDIES / f"study_{study.replace('-', '_')}.py").read_text(encoding="utf-8")
        question = (ast.get_docstring(ast.parse(code)) or study).splitlines()[0]
        source[0] = f"# {question.removesuffix('.')}\n\n{source[0]}"


def setup(app: Sphinx) -> dict[str, bool]:
    """When a page is read."""
    app.connect("source-read", mend)
    app.connect("source-read", entitle)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
