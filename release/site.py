"""Gather the documentation of all versions into one site: `python -m release.site LATEST RELEASES OUTPUT`.

`LATEST` is the site of the current sources (`make docs`). `RELEASES` has an archive `docs-X.Y.Z.zip` for each release,
the site of its version. `OUTPUT` gets a folder for each, `versions.json` for the list in the sidebar
(`docs/_static/versions.js`), and a first page that leads to the last release.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

ARCHIVE = re.compile(r"docs-(\d+)\.(\d+)\.(\d+)\.zip")
LATEST = "latest"
FIRST_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>gmwm</title>
<meta http-equiv="refresh" content="0; url={folder}/">
<link rel="canonical" href="{folder}/">
<a href="{folder}/">Documentation of gmwm</a>
</html>
"""


class SiteError(Exception):
    """A part of the site is not what it must be."""


def gather(latest: Path, releases: Path, output: Path) -> list[dict[str, str]]:
    """Write the site into an empty folder; return the content of `versions.json`, latest first, then newest first."""
    output.mkdir(parents=True)
    shutil.copytree(latest, output / LATEST)
    versions = sorted(map(_version, releases.iterdir()), reverse=True)
    for version in versions:
        name = _name(version)
        shutil.unpack_archive(releases / f"docs-{name}.zip", output / name)
    names = [LATEST, *map(_name, versions)]
    empty = [name for name in names if not (output / name / "index.html").is_file()]
    if empty:
        raise SiteError(f"no index.html in the site of {', '.join(empty)}")
    listed = [{"folder": name, "title": "development" if name == LATEST else name} for name in names]
    (output / "versions.json").write_text(json.dumps(listed, indent=1) + "\n", encoding="utf-8")
    (output / "index.html").write_text(FIRST_PAGE.format(folder=names[min(1, len(versions))]), encoding="utf-8")
    return listed


def _version(archive: Path) -> tuple[int, ...]:
    found = ARCHIVE.fullmatch(archive.name)
    if found is None:
        raise SiteError(f"expected docs-X.Y.Z.zip, found {archive.name}")
    return tuple(map(int, found.groups()))


def _name(version: Sequence[int]) -> str:
    return ".".join(map(str, version))


if __name__ == "__main__":
    print(gather(*map(Path, sys.argv[1:])))
