"""The documentation for users stays short: tests/house_figures.py counts its words."""

import pytest

from tests.house_figures import words_of_documents

pytestmark = pytest.mark.docs

MOST = 75_000
"""Largest number of words. It was 127 700 before pages were merged."""
LONGEST = 3_300
"""Largest number of words of a page."""


def test_the_documentation_has_few_words():
    pages = words_of_documents()
    assert len(pages) > 80
    assert sum(count for count, _ in pages) <= MOST
    assert [(count, page.name) for count, page in pages if count > LONGEST] == []
