"""The pages of the documentation, and a way to run what stands in them: `python -m tests.docs.pages PAGE` runs one."""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import re
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from tests.forked import Forks

DOCS = Path(__file__).parents[2] / "docs"
BLOCK = re.compile(r"^```(python|sh|text|console)\n(.*?)^```", re.MULTILINE | re.DOTALL)
PRINTED = "printed.json"
"""What each block printed, by its line on the page: written where a page was run."""


def pages() -> list[Path]:
    """Every page that somebody wrote; those of studies are written by their command."""
    generated = DOCS / "validation"
    return sorted(page for page in DOCS.rglob("*.md") if generated not in page.parents)


def fenced(page: Path) -> list[tuple[int, str, str]]:
    """Line of the page, language and text of each block of code or of what it prints."""
    text = page.read_text(encoding="utf-8")
    return [(text.count("\n", 0, block.start(2)), block[1], block[2]) for block in BLOCK.finditer(text)]


def blocks(page: Path) -> list[tuple[int, str, str]]:
    """Those that run; of shells only what calls gmwm, of consoles what does so behind a `$`."""
    found = []
    for line, language, text in fenced(page):
        code = prompted(text) if language == "console" else text
        if language == "python" or (language != "text" and commands(code)):
            found.append((line, language, code))
    return found


def prompted(text: str) -> str:
    """What somebody typed in a console."""
    return "".join(f"{line[2:]}\n" for line in text.splitlines() if line.startswith("$ "))


class Shown(NamedTuple):
    """A block that shows what was printed, or what stands in a file."""

    line: int
    text: str
    above: list[int]
    """Lines of the blocks that it may come from: those that run between it and the last that was shown."""
    files: list[str]
    """Names in those, and in the paragraph above it, that may be of files."""


def shown(page: Path) -> list[Shown]:
    """Each block of a page that is no code."""
    text = page.read_text(encoding="utf-8").splitlines()
    running = {line: code for line, _, code in blocks(page)}
    found: list[Shown] = []
    above: list[int] = []
    for line, language, shows in fenced(page):
        if line in running:
            above.append(line)
        if language in ("text", "console"):
            before = "\n".join(text[: line - 1]).rstrip().rpartition("\n\n")[2]
            words = "\n".join([before, *(running[one] for one in above)])
            answer = "".join(f"{row}\n" for row in shows.splitlines() if not row.startswith("$ "))
            found.append(Shown(line, answer, above, re.findall(r"[\w./-]+\.\w+", words)))
            above = []
    return found


def commands(code: str) -> list[str]:
    """Those lines of a shell block that call gmwm."""
    lines = code.replace("\\\n", " ").splitlines()
    return [line for line in lines if shlex.split(line, comments=True)[:1] == ["gmwm"]]


def run(page: str) -> None:
    """Run a page's blocks from top to bottom, in this folder and in one namespace, and write down what they print."""
    forks = Forks.of_this_process()  # before a block changes it
    os.environ["PATH"] = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    names: dict[str, object] = {"__name__": "__main__"}
    printed: dict[int, str] = {}
    for line, language, code in blocks(Path(page)):
        with listening(printed, line):
            if language == "python":
                # So many empty lines, so that an error names the line of the page.
                exec(compile("\n" * line + code, page, "exec"), names)
                continue
            for command in commands(code):
                status = typed(command, forks)
                # In a console an error may be what is shown.
                if status and language == "sh":
                    raise SystemExit(f"{page}:{line}: {status} from {command}")
    Path(PRINTED).write_text(json.dumps(printed), encoding="utf-8")


def typed(command: str, forks: Forks) -> int:
    """The exit code of a command. A shell runs it if it has to do more than to split it into words."""
    if set(command) & set("|&;<>$`*?~"):
        return subprocess.run(["bash", "-euo", "pipefail", "-c", command], check=False).returncode
    streams = [f"/proc/{os.getpid()}/fd/{number}" for number in (1, 2)]
    return forks.write_to(streams, "tests.forked:gmwm", *shlex.split(command)[1:], folder=Path.cwd())


@contextlib.contextmanager
def listening(printed: dict[int, str], line: int) -> Iterator[None]:
    """Note what this process and those it starts print, then what they say of errors, and print it after all."""
    streams = (sys.stdout, sys.stderr)
    with contextlib.ExitStack() as kept:
        files = [kept.enter_context(tempfile.TemporaryFile()) for _ in streams]
        for file in files:  # A shell and a forked command have positions of their own.
            fcntl.fcntl(file, fcntl.F_SETFL, fcntl.fcntl(file, fcntl.F_GETFL) | os.O_APPEND)
        before = [os.dup(number) for number in (1, 2)]
        for number, (stream, file) in enumerate(zip(streams, files, strict=True), start=1):
            stream.flush()
            os.dup2(file.fileno(), number)
        try:
            yield
        finally:
            for number, (stream, old) in enumerate(zip(streams, before, strict=True), start=1):
                stream.flush()
                os.dup2(old, number)
                os.close(old)
            printed[line] = ""
            for file in files:
                file.seek(0)
                printed[line] += file.read().decode("utf-8")
            print(printed[line], end="", flush=True)


if __name__ == "__main__":
    run(str(Path(sys.argv[1]).resolve()))
