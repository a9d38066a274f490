"""Make every picture of the documentation, and the output that stands under its code: `python -m docs.pictures`.

The pictures of a page are those that its own blocks of Python write, so that what is shown is what the code beside it
makes. What a block prints goes into the block of text that follows it. The rest is in the modules beside this one.
Names of pages make those alone: `python -m docs.pictures gallery`.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import sys
import tempfile
from pathlib import Path

from PIL import Image

from docs import message_pages
from docs.pictures import front, logo, processes, valleys

FOLDER = Path(__file__).parent
DOCS = FOLDER.parent
PAGES = (
    DOCS / "gallery.md",
    DOCS / "howto" / "array.md",
    DOCS / "howto" / "joint.md",
    DOCS / "howto" / "conditions.md",
    DOCS / "howto" / "contaminated.md",
    DOCS / "howto" / "recordings.md",
    DOCS / "next" / "gnss-series.md",
    DOCS / "next" / "consistency.md",
    *sorted((DOCS / "concepts").glob("*.md")),
)
BLOCK = re.compile(r"^```python\n(?P<code>.*?)^```\n(?:\n```text\n(?P<printed>.*?)^```\n)?", re.MULTILINE | re.DOTALL)
WIDEST = 1400
"""Dots of a picture on a page at twice its width there; what is drawn for print has more."""
COLOURS = 128
LARGEST = 150_000
"""Bytes of a picture, at most."""


def run(page: Path) -> list[Path]:
    """Run the blocks of a page from top to bottom, put what they print under them, and give the pictures they write."""
    space: dict[str, object] = {}

    def ran(block: re.Match[str]) -> str:
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile(block["code"], str(page), "exec"), space)
        if block["printed"] is None:
            return block[0]
        text = "".join(f"{line.rstrip()}\n" for line in printed.getvalue().splitlines())
        return f"```python\n{block['code']}```\n\n```text\n{text}```\n"

    before = Path.cwd()
    with tempfile.TemporaryDirectory() as place:
        os.chdir(place)
        try:
            text = BLOCK.sub(ran, page.read_text(encoding="utf-8"))
            page.write_text(text, encoding="utf-8")
            return [moved(file) for file in sorted(Path(place).iterdir()) if file.suffix in (".svg", ".png")]
        finally:
            os.chdir(before)


def moved(file: Path) -> Path:
    """The picture in its place; of dots, no more than a page shows."""
    target = FOLDER / file.name
    if file.suffix == ".svg":
        target.write_bytes(file.read_bytes())
        return target
    with Image.open(file) as picture:
        small = picture.convert("RGB")
        small.thumbnail((WIDEST, 2 * WIDEST))
        small.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)
    return target


def main(names: list[str]) -> int:
    """Those whose names are given, or all; 1 if a picture is too large or written twice."""
    scripts = {"logo": logo, "front": front, "each-process": processes, "valleys": valleys}
    makers = {name: lambda script=script: script.write(FOLDER) for name, script in scripts.items()}
    makers["messages"] = message_pages.write
    makers |= {page.stem: lambda page=page: run(page) for page in PAGES}
    unknown = [name for name in names if name not in makers]
    if unknown:
        sys.exit(f"no such page: {', '.join(unknown)}; there are {', '.join(makers)}")
    written = [path for name in names or makers for path in makers[name]()]
    bad = [path for path in written if path.stat().st_size > LARGEST or written.count(path) > 1]
    for path in sorted({*written}):
        print(f"{path.stat().st_size:8d}  {path.name}{'  TOO LARGE, OR WRITTEN TWICE' if path in bad else ''}")
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
