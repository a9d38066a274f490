"""The loop over cases that the tests use names the case that fails, and leaves out none."""

import inspect

import pytest

from tests.helpers import each


def test_every_case_runs_and_a_failure_names_its_cases():
    ran = []

    @each("letter", "abc")
    @each(("low", "high"), [(1, 2), (3, 4)])
    def test(fixture, letter, low, high):
        ran.append((letter, low))
        assert (letter, high) != ("a", 4), fixture
        assert letter != "c"

    assert list(inspect.signature(test).parameters) == ["fixture"]
    with pytest.raises(AssertionError, match=r"in the cases {'letter': 'a'}, {'letter': 'c'}$") as caught:
        test(fixture="of pytest")
    assert str(caught.value.__cause__) == "in the cases {'low': 3, 'high': 4}"
    assert ran == [(letter, low) for letter in "abc" for low in (1, 3)]


def test_a_case_of_another_length_is_an_error():
    with pytest.raises(ValueError, match="zip"):
        each("low, high", [(1, 2, 3)])(lambda low, high: None)()
