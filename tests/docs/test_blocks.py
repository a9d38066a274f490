"""What stands in the pages runs: every block of Python, every command of gmwm, in order, in an empty folder.

And what they show as printed is what is printed then; `shown` says how near.
"""

import json
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import pytest

from tests.docs import pages, shown

RUNNING = {str(page.relative_to(pages.DOCS)): page for page in pages.pages() if pages.blocks(page)}
ELSEWHERE = {
    ("coming-from/imu-tools.md", "gmwm calibrate recording.bag"): "to be typed",
    ("exporters.md", "# CAUTION"): "an example of its words",
    ("exporters.md", "# UPPER LIMIT"): "an example of its words",
    ("fleet.md", "Gyroscopes"): "an example of sixty units, to be read",
    ("howto/add-a-process.md", "def state_space"): "to be written",
    ("howto/record.md", "ros2 bag record"): "to be typed",
    ("index.md", "…"): "of the command in start.md",
    ("navigation.md", "Fitted to 8 h"): "a hundred drives, which take minutes",
    ("start.md", "--columns time"): "to be typed",
}
"""Blocks that look like output, but are not that of the blocks above them, by their first words; and what they are."""


@cache
def run(name: str, folder: Path) -> tuple[subprocess.CompletedProcess[str], Path]:
    """A page, run once for all that is asked of it."""
    place = folder / name.replace("/", "-")
    place.mkdir(exist_ok=True)
    # Each in a process of its own: a page may add a process or a reader, which no other test should meet.
    command = [sys.executable, pages.__file__, str(RUNNING[name])]
    settings = {**os.environ, "MPLBACKEND": "Agg", "COLUMNS": "100"}
    done = subprocess.run(command, cwd=place, env=settings, capture_output=True, encoding="utf-8", timeout=120)
    return done, place


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def test_there_are_pages_with_blocks():
    assert {"index.md", "start.md", "likelihood.md"} <= set(RUNNING)


@pytest.mark.parametrize("name", RUNNING)
def test_the_blocks_of_a_page_run(name, folder):
    done, place = run(name, folder)
    assert done.returncode == 0, f"{done.stdout[-1000:]}\n{done.stderr[-3000:]}"
    # Written after the last block: a block that ends the process does not hide those below it.
    assert (place / pages.PRINTED).is_file()


@pytest.mark.parametrize("name", [name for name, page in RUNNING.items() if pages.shown(page)])
def test_what_a_page_shows_is_what_it_prints(name, folder):
    blocks = [block for block in pages.shown(RUNNING[name]) if not elsewhere(name, block.text)]
    _, place = run(name, folder)
    printed = json.loads((place / pages.PRINTED).read_text(encoding="utf-8"))
    wrong = {}
    for block in blocks:
        sources = ["".join(printed[str(line)] for line in block.above)]
        sources += [beginning(place / file) for file in block.files if (place / file).is_file()]
        told = [shown.missing(block.text, source) for source in sources]
        if all(told):
            wrong[f"{name}:{block.line}"] = told[0]
    assert wrong == {}, "\n".join(f"{where}\n{what}" for where, what in wrong.items())


def test_the_front_page_shows_what_start_prints(folder):
    (block,) = pages.shown(pages.DOCS / "index.md")
    _, place = run("start.md", folder)
    printed = json.loads((place / pages.PRINTED).read_text(encoding="utf-8"))
    assert shown.missing(block.text, "".join(printed.values())) == ""


def test_blocks_that_are_not_printed_are_there():
    texts = {name: [block.text for block in pages.shown(pages.DOCS / name)] for name, _ in ELSEWHERE}
    assert [key for key in ELSEWHERE if sum(text.startswith(key[1]) for text in texts[key[0]]) != 1] == []


def elsewhere(name, text):
    """Whether a block is one of those that the blocks above it do not print."""
    return any(page == name and text.startswith(words) for page, words in ELSEWHERE)


def beginning(path):
    """The first lines of a file, and of one that holds no text nothing that a page would show."""
    with path.open("rb") as file:
        return file.read(20_000).decode("utf-8", errors="replace")
