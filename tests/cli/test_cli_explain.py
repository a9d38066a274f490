"""gmwm explain: what a message means and what to do."""

import pytest

from gmwm.base.remarks import messages
from tests.helpers import each


@pytest.mark.slow
@each("code", messages())
def test_every_message_is_explained(gmwm, code):
    outcome = gmwm("explain", code)
    assert outcome.code == 0
    assert outcome.out.startswith(f"{code} (")
    assert max(map(len, outcome.out.splitlines())) <= 80
    assert "](" not in outcome.out


def test_the_advice_is_for_the_shell(gmwm):
    assert "--units" in gmwm("explain", "unit-doubtful").out


def test_brackets_as_in_the_terminal_are_allowed(gmwm):
    assert gmwm("explain", "[lines]").out == gmwm("explain", "lines").out


def test_without_a_code_all_codes_are_listed(gmwm):
    words = set(gmwm("explain").out.replace(",", " ").split())
    assert set(messages()) <= words
    assert gmwm("explain", "--json").json["codes"] == list(messages())


def test_an_unknown_code_names_similar_ones(gmwm):
    gmwm("explain", "warmup").require_refusal("warm-up")
