"""The pages of the documentation, and a way to run what stands in them; `python tests/docs/pages.py PAGE` runs one."""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(python|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)


def pages() -> list[Path]:
    """Every page that somebody wrote; those of studies are written by their command."""
    generated = DOCS / "validation"
    return sorted(page for page in DOCS.rglob("*.md") if generated not in page.parents)


def blocks(page: Path) -> list[tuple[int, str, str]]:
    """Line of the page, language and code of each block that runs; of shells only what calls gmwm."""
    text = page.read_text(encoding="utf-8")
    found = [(text.count("\n", 0, block.start(2)), block[1], block[2]) for block in BLOCK.finditer(text)]
    return [(line, language, code) for line, language, code in found if language == "python" or commands(code)]


def commands(code: str) -> list[str]:
    """Those lines of a shell block that call gmwm."""
    lines = code.replace("\\\n", " ").splitlines()
    return [line for line in lines if shlex.split(line, comments=True)[:1] == ["gmwm"]]


def run(page: Path) -> None:
    """Run a page's blocks from top to bottom, in this folder and in one namespace."""
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    names: dict[str, object] = {"__name__": "__main__"}
    for line, language, code in blocks(page):
        if language == "python":
            # So many empty lines, so that an error names the line of the page.
            exec(compile("\n" * line + code, str(page), "exec"), names)
            continue
        for command in commands(code):
            done = subprocess.run(["bash", "-euo", "pipefail", "-c", command], check=False)
            if done.returncode:
                raise SystemExit(f"{page}:{line}: {done.returncode} from {command}")


if __name__ == "__main__":
    run(Path(sys.argv[1]).resolve())
