"""Reduced run of validation/study_rest.py: the intervals of the mean hold, and those for white noise do not."""

import pytest

from validation import study_rest

pytestmark = pytest.mark.slow


def test_the_interval_of_the_model_holds_the_bias():
    result = study_rest.run(reduced=True)
    white, walk = result["rows"]
    # Of 24 intervals at 95 %, fewer than 19 hold once in a thousand times.
    assert min(white["covered"], walk["covered"]) > 0.78
    assert walk["naive"] < 0.5
    assert study_rest.table(result).count("\n|") == 2 + 2
