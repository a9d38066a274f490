"""The sizes of the core and of its extras in `docs/install.md` are those of the installed files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from release.sizes import sizes

PAGE = Path(__file__).parents[2] / "docs" / "install.md"


@pytest.mark.slow
def test_sizes_of_the_page_are_those_of_the_files() -> None:
    rows = re.findall(r"^\| (?:none|`(\w+)`) \| .* \| (\d+) \|$", PAGE.read_text(), flags=re.MULTILINE)
    assert {extra: float(megabytes) for extra, megabytes in rows} == pytest.approx(sizes(), rel=0.2, abs=5)
