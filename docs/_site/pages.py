"""Pages that GitHub's readers see too: links to files beside docs/, and the appendices of studies."""

from __future__ import annotations

import json
import re
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks import page as benchmarks
from benchmarks.results import Results
from validation.pages import appendix

if TYPE_CHECKING:
    from sphinx.application import Sphinx

PAGES = {
    "README.md": "index",
    "CONTRIBUTING.md": "contributing/index",
    "CHANGELOG.md": "changelog",
    "docs/README.md": "index",
}
"""Files of the repository, and the page that says the same."""

SECTIONS = {"README.md#what-the-numbers-mean": "numbers"}
"""Sections that are pages of their own here."""

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


def append(app: Sphinx, name: str, source: list[str]) -> None:
    """Append all tables of a study, or of the benchmarks, to the page."""
    folder, _, study = name.rpartition("/")
    if folder == "validation":
        module = import_module(f"validation.study_{study.replace('-', '_')}")
        result = json.loads(Path(app.srcdir, folder, f"{study}.json").read_text(encoding="utf-8"))
        source[0] += f"\n## Appendix\n\n{appendix(module, result)}"
    if name == benchmarks.NAME:
        values = json.loads(Path(app.srcdir, f"{name}.json").read_text(encoding="utf-8"))
        source[0] += f"\n{benchmarks.appendix(Results(values))}"


def setup(app: Sphinx) -> dict[str, bool]:
    """When a page is read."""
    app.connect("source-read", mend)
    app.connect("source-read", append)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
