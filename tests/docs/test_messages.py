"""The pages on messages are those that the registry gives, with an anchor for each code."""

import re

import pytest

from docs.message_pages import FOLDER, contents
from gmwm.base.remarks import Severity, messages
from gmwm.base.remarks.registry import SECTIONS
from tests.helpers import each


@pytest.mark.parametrize("page", [pytest.param(path, id=path.name) for path in contents()])
def test_a_page_is_generated(page):
    # After a change of the registry: python -m docs.message_pages
    assert contents()[page].splitlines() == page.read_text(encoding="utf-8").splitlines()


def test_there_are_no_other_pages():
    assert set(FOLDER.iterdir()) == set(contents())


@pytest.mark.parametrize("section", SECTIONS)
def test_every_code_is_a_heading_and_an_anchor_of_its_page(section):
    text = (FOLDER / f"{section}.md").read_text(encoding="utf-8")
    headings = re.findall(r"^## `([a-z0-9-]+)`$", text, re.MULTILINE)
    assert headings == [message.code for message in messages().values() if message.section == section]


def test_the_first_page_leads_to_every_code_and_has_all_severities():
    text = (FOLDER / "index.md").read_text(encoding="utf-8")
    links = re.findall(r"\[([a-z0-9-]+)\]\(([a-z]+)\.md#([a-z0-9-]+)\)", text)
    assert {(code, section, code) for code, section, _ in links} == set(links)
    assert {code: section for code, section, _ in links} == {m.code: m.section for m in messages().values()}
    assert re.findall(r"^\| (\w+) \|", text, re.MULTILINE)[1:] == [severity.label for severity in Severity]


@each("message", messages().values())
def test_an_entry_has_the_meaning(message):
    text = (FOLDER / f"{message.section}.md").read_text(encoding="utf-8")
    (entry,) = re.findall(rf"^## `{message.code}`\n(.*?)(?=^## |\Z)", text, re.MULTILINE | re.DOTALL)
    assert message.meaning in entry
