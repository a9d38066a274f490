"""Remarks: every message renders, merges and survives JSON; one snapshot per renderer holds the prose."""

import json
import re
from dataclasses import replace

import pytest

from gmwm.base.remarks import (
    Dialect,
    Quantity,
    Remark,
    Severity,
    brief,
    gravest,
    merged,
    messages,
    sorted_remarks,
    texts,
)
from gmwm.base.remarks.registry import CASE, OTHERWISE, SECTIONS, Choice
from gmwm.base.remarks.registry import message as message_of
from gmwm.base.remarks.rendering import examples
from tests.helpers import each
from tests.remarks.snapshot import file_of, rendered

ALL = tuple(messages().values())


@pytest.mark.parametrize("dialect", Dialect)
def test_every_sentence_is_the_one_in_the_snapshot(dialect):
    # After a deliberate change of wording: python -m tests.remarks.snapshot
    assert rendered(dialect).splitlines() == file_of(dialect).read_text(encoding="utf-8").splitlines()


@each("message", ALL)
def test_a_message_is_complete(message):
    assert message.section in SECTIONS
    assert re.fullmatch(r"[a-z0-9]+(-[a-z0-9]+)*", message.code)
    assert message.meaning, "the documentation needs to say what it means for the numbers"
    for text in (message.sentence, message.advice):
        assert not isinstance(text, Choice) or len(text.templates) > 1


@each("message", ALL)
def test_what_makes_numbers_wrong_has_a_name_in_plain_words(message):
    assert message.cause or not (message.raises or message.spoils)


def test_messages_with_the_same_advice_have_one_code():
    assert len(messages()) <= 110


ANSWERS = ("verdict", "results", "check-passed", "recommended")
"""Messages whose sentence is the answer itself."""


@each("message", ALL)
def test_every_remark_ends_with_what_to_do(message):
    for remark in examples(message):
        assert remark.advice or message.code in ANSWERS


@each("message", ALL)
def test_there_is_an_example_of_each_case(message):
    texts_by_case = (text for text in (message.severity, message.sentence, message.advice) if isinstance(text, Choice))
    cases = {case for text in texts_by_case if text.by == CASE for case in text.templates} - {OTHERWISE}
    assert {example.get(CASE, "") for example in message.examples} >= cases


@each("message", ALL)
def test_a_message_parsed_alone_is_the_same_as_in_the_whole_file(message):
    assert message_of(message.code) == message


@each("message", ALL)
def test_a_message_survives_json(message):
    for remark in examples(message):
        assert Remark.from_dict(json.loads(json.dumps(remark.to_dict()))) == remark


@each("message", ALL)
def test_sentences_are_short_and_end(message):
    for remark in examples(message):
        text = remark.text(Dialect.SHELL)
        assert text.endswith((".", "?"))
        assert "  " not in text
        for sentence in re.split(r"(?<=[.?]) (?=[A-Z])", text):
            assert len(sentence.split()) <= 45, sentence


def test_the_registry_says_which_fact_is_missing():
    with pytest.raises(KeyError, match="count"):
        Remark.of("stamps-irregular", case="repeated")
    with pytest.raises(KeyError, match="no-such-code"):
        Remark.of("no-such-code")


def test_severities_order_from_the_gravest():
    low, high = (
        Remark.of("stamps-irregular", case="repeated", count=1),
        Remark.of("not-calibrated", "gyro_x", case="calibration", reason="it is constant"),
    )
    assert sorted_remarks([low, high, low]) == [high, low]
    assert gravest([low, high]) is Severity.UNUSABLE
    assert gravest([]) is None


def test_the_same_remark_about_several_axes_is_one_text():
    remarks = [
        Remark.of("outliers-left-out", axis, excess=f"by {k} %", tau=Quantity(0.04, "s"))
        for k, axis in enumerate(["gyro_x", "gyro_y", "accel_z"], 1)
    ]
    (text,) = texts(remarks)
    assert all(f"{axis} (by {k} % at 0.04 s)" in text for k, axis in enumerate(["gyro_x", "gyro_y", "accel_z"], 1))


def test_remarks_that_differ_in_what_is_said_of_all_stay_apart():
    remarks = [
        Remark.of("term-zero", axis, case="fit", term=term) for axis, term in (("gyro_x", "QN"), ("gyro_y", "RW"))
    ]
    assert [len(group) for group in merged(remarks)] == [1, 1]
    assert [len(group) for group in merged([remarks[0], remarks[0].about("gyro_z")])] == [2]


def test_a_disturbance_of_all_axes_is_one_text():
    """The five texts of a terminal were those of five axes with one jump at nearly the same time."""
    jumps = {"case": "jumps", "count": 1, "size": Quantity(20.6, "deg/h")}
    pulses = {"case": "pulses", "numbers": ("N",)}
    for code, facts, name, values in (
        ("fault-undone", jumps, "places", (("1429 s",), ("1446 s",))),
        ("outliers-found", pulses, "taus", ((Quantity(2.56, "s"),), (Quantity(1.28, "s"),))),
    ):
        remarks = [Remark.of(code, axis, **facts, **{name: value}) for axis, value in zip("xy", values, strict=True)]
        (text,) = texts(remarks)
        assert "x (" in text
        assert "y (" in text


def test_a_terminal_shows_five_remarks_and_counts_the_others():
    remarks = [Remark.of("stamps-irregular", f"file {k}.csv", case="repeated", count=k) for k in range(1, 10)]
    lines = brief(remarks, rest="report.html")
    assert len(lines) == 6
    assert lines[-1] == "and 4 more in report.html"
    assert lines[0].endswith("[stamps-irregular]")


def test_names_from_files_are_escaped_in_html():
    remark = Remark.of("not-calibrated", "<b>", case="calibration", reason="a < b")
    text = remark.text(Dialect.HTML)
    assert "&lt;b&gt;" in text
    assert "a &lt; b" in text
    assert "<b>" not in text


def test_subjects_with_the_same_detail_state_it_once():
    time = Quantity(1200.0, "s")
    remarks = [Remark.of("heavy-tails", axis, case="changes", share=500.0, time=time) for axis in ("gyro_x", "gyro_y")]
    (text,) = texts(remarks)
    assert "gyro_x and gyro_y (each 500 % more, and most at about 1200 s)" in text
    remarks[1] = replace(remarks[1], facts={**remarks[1].facts, "share": 30.0})
    assert "gyro_y (30 % more" in texts(remarks)[0]
