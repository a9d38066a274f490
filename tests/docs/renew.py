"""Write what the blocks of start.md print into start.md and index.md: `python -m tests.docs.renew`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.docs import pages, shown


def main() -> None:
    """Run start.md in an empty folder, and renew every block of both pages that shows what it prints."""
    start = pages.DOCS / "start.md"
    with tempfile.TemporaryDirectory() as name:
        place = Path(name)
        environment = {**os.environ, "PYTHONPATH": str(pages.DOCS.parent), "COLUMNS": "100"}
        command = [sys.executable, "-m", "tests.docs.pages", str(start)]
        subprocess.run(command, cwd=place, env=environment, check=True, capture_output=True)
        printed = json.loads((place / pages.PRINTED).read_text(encoding="utf-8"))
        for page, every in ((start, False), (pages.DOCS / "index.md", True)):
            text = page.read_text(encoding="utf-8")
            for block in pages.shown(page):
                sources = [printed[str(line)] for line in ([] if every else block.above)]
                sources += ["".join(printed.values())] if every else []
                sources += [
                    (place / file).read_text("utf-8", "replace")[:10_000]
                    for file in block.files
                    if (place / file).is_file()
                ]
                for source in sources:
                    try:
                        text = text.replace(block.text, shown.renewed(block.text, source))
                    except LookupError:
                        continue
                    break
            page.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
