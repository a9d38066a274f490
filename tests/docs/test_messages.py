"""The page on messages is the one that the registry gives, with an anchor for each code."""

import re

import pytest

from docs.messages import PAGE, examples, page
from gmwm.base.remarks import Severity, messages
from gmwm.base.remarks.registry import SECTIONS

TEXT = PAGE.read_text(encoding="utf-8")
HEADINGS = re.findall(r"^(#+) (.+)$", TEXT, re.MULTILINE)


def test_the_page_is_generated():
    # After a change of the registry: python -m docs.messages
    assert page().splitlines() == TEXT.splitlines()


def test_every_code_is_a_heading_and_an_anchor_of_its_own():
    anchors = [re.sub(r"[^a-z0-9 -]", "", title.lower()).replace(" ", "-") for _, title in HEADINGS]
    assert len(set(anchors)) == len(anchors)
    assert set(messages()) <= set(anchors)


def test_all_sections_and_severities_are_on_the_page():
    used = {message.section for message in messages().values()}
    assert [title for mark, title in HEADINGS if mark == "##"][1:] == [
        title for section, title in SECTIONS.items() if section in used
    ]
    table = re.findall(r"^\| (\w+) \|", TEXT, re.MULTILINE)
    assert table[1:] == [severity.label for severity in Severity]


@pytest.mark.parametrize("message", [pytest.param(message, id=message.code) for message in messages().values()])
def test_an_entry_has_every_variant_and_the_meaning(message):
    (entry,) = re.findall(rf"^### `{message.code}`\n(.*?)(?=^##|\Z)", TEXT, re.MULTILINE | re.DOTALL)
    lines = re.sub(r"\\([*\[\]<])", r"\1", entry).replace("`", "").splitlines()
    sentences = [line.removeprefix("> ") for line in lines if line.startswith("> ")]
    advice = [line.removeprefix("**What to do.** ").removeprefix("- ") for line in lines]
    for remark in examples(message):
        text = remark.to_dict()["text"].replace("`", "")
        assert any(
            text == f"{one} {other}".rstrip() for one in sentences for other in (advice if remark.advice else [""])
        )
    assert f"**Severity:** {message.severity.label}. {message.meaning}" in entry
