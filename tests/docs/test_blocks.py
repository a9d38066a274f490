"""What stands in the pages runs: every block of Python, every command of gmwm, in order, in an empty folder."""

import os
import subprocess
import sys

import pytest

from tests.docs import pages

RUNNING = {str(page.relative_to(pages.DOCS)): page for page in pages.pages() if pages.blocks(page)}


def test_there_are_pages_with_blocks():
    assert {"index.md", "start.md", "likelihood.md"} <= set(RUNNING)


@pytest.mark.parametrize("name", RUNNING)
def test_the_blocks_of_a_page_run(name, tmp_path):
    # Each in a process of its own: a page may add a process or a reader, which no other test should meet.
    command = [sys.executable, pages.__file__, str(RUNNING[name])]
    settings = {**os.environ, "MPLBACKEND": "Agg", "COLUMNS": "100"}
    done = subprocess.run(command, cwd=tmp_path, env=settings, capture_output=True, encoding="utf-8", timeout=120)
    assert done.returncode == 0, f"{done.stdout[-1000:]}\n{done.stderr[-3000:]}"
