"""The notebooks run from top to bottom, and show what is stored in them."""

import os
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from tests.docs.pages import DOCS

pytestmark = pytest.mark.docs

NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))
LARGEST = 500_000
"""Bytes of a notebook with its pictures."""


def test_there_are_two():
    assert [path.stem for path in NOTEBOOKS] == ["robotics", "statistics"]


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_stored_as_executed(path: Path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    outputs = [output for cell in code for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"] == []
    assert path.stat().st_size < LARGEST
    printed = "".join(output.get("text", "") for output in outputs)
    assert [place for place in ("/tmp", "/home", "/root", "\\Users", "ipykernel") if place in printed] == []


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_runs_and_shows_what_is_stored(path: Path):
    # In a process of its own: the client of the kernel warns in ways that are not ours.
    command = [sys.executable, str(DOCS / "notebooks" / "execute.py"), "--check", str(path)]
    done = subprocess.run(command, capture_output=True, encoding="utf-8", env={**os.environ, "NO_COLOR": "1"})
    assert done.returncode == 0, done.stderr[-3000:]
