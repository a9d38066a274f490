"""What stands in the pages runs: every block of Python, every command of gmwm, in order, in an empty folder.

And what they show as printed is what is printed then; `shown` says how near.
"""

import json
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.docs import pages, shown
from tests.forked import Done, Forks

pytestmark = pytest.mark.docs

RUNNING = {str(page.relative_to(pages.DOCS)): page for page in pages.pages() if pages.blocks(page)}
ELSEWHERE = {
    ("coming-from/imu-tools.md", "gmwm calibrate recording.bag"): "to be typed",
    ("exporters.md", "# Noise of an IMU"): "an example of a file",
    ("fleet.md", "Gyroscopes"): "an example of sixty units, to be read",
    ("contributing/add-a-process.md", "def state_space"): "to be written",
    ("howto/record.md", "ros2 bag record"): "to be typed",
    ("index.md", "The calibration can be used"): "of the command in start.md",
    ("navigation.md", "100 drives of 480 s"): "a hundred drives, which take minutes",
    ("start.md", "--columns time"): "to be typed",
}
"""Blocks that look like output, but are not that of the blocks above them, by their first words; and what they are."""


EXACT = ("index.md", "start.md")
"""Pages whose numbers are those that are printed, to the last digit; `python -m tests.docs.renew` writes them anew."""


class Run(NamedTuple):
    """A page that was run in a folder of its own."""

    name: str
    done: Done
    place: Path

    def printed(self) -> dict[str, str]:
        return json.loads((self.place / pages.PRINTED).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def run(request: pytest.FixtureRequest, forks: Forks, tmp_path_factory: pytest.TempPathFactory) -> Run:
    """The page of this name, run once for the tests that follow one another; these ask for it by name."""
    place = tmp_path_factory.mktemp("page")
    # Each in a process of its own: a page may add a process or a reader, which no other test should meet.
    done = forks.run("tests.docs.pages:run", str(RUNNING[request.param]), folder=place, COLUMNS="100")
    return Run(request.param, done, place)


def test_there_are_pages_with_blocks():
    assert {"index.md", "start.md", "likelihood.md"} <= set(RUNNING)


@pytest.mark.parametrize("run", RUNNING, indirect=True)
def test_the_blocks_of_a_page_run(run):
    assert run.done.returncode == 0, f"{run.done.stdout[-1000:]}\n{run.done.stderr[-3000:]}"
    # Written after the last block: a block that ends the process does not hide those below it.
    assert (run.place / pages.PRINTED).is_file()


@pytest.mark.parametrize("run", [name for name, page in RUNNING.items() if pages.shown(page)], indirect=True)
def test_what_a_page_shows_is_what_it_prints(run):
    printed = run.printed()
    wrong = {}
    for block in pages.shown(RUNNING[run.name]):
        if elsewhere(run.name, block.text):
            continue
        sources = ["".join(printed[str(line)] for line in block.above)]
        sources += [beginning(run.place / file) for file in block.files if (run.place / file).is_file()]
        apart = 0.0 if run.name in EXACT else shown.APART
        if all(shown.missing(block.text, source, apart) for source in sources):
            wrong[f"{run.name}:{block.line}"] = shown.missing(block.text, sources[0], apart)
    assert wrong == {}, "\n".join(f"{where}\n{what}" for where, what in wrong.items())


@pytest.mark.parametrize("run", ["start.md"], indirect=True)
def test_the_front_page_shows_what_start_prints(run):
    (block,) = pages.shown(pages.DOCS / "index.md")
    assert shown.missing(block.text, "".join(run.printed().values()), 0.0) == ""


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
