"""Reduced run of validation/study_weak.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_weak

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_limits_of_what_is_barely_seen_are_not_too_low():
    result = study_weak.run(reduced=True)
    assert len(result["rows"]) == 6
    for row in result["rows"]:
        assert row["limit_covers"] >= 0.75, row
        assert row["median_limit"] > row["truth"], row
        assert row["unlimited"] == 0, row
        # A walk or drift of which the error is larger than itself must not be said to be seen.
        assert row["relative_error"] < 1 or row["one_sided"] > 0.5, row
    assert study_weak.table(result).count("\n|") == 8
