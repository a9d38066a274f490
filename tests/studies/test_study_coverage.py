"""Reduced run of validation/study_coverage.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_coverage

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_intervals_hold_the_truth():
    result = study_coverage.run(reduced=True)
    assert len(result["rows"]) == 10
    noise = 1 / result["recordings"] ** 0.5
    for row in result["rows"]:
        # A share of 95 % in n recordings scatters by 0.22 / √n.
        assert row["covered"] > 0.95 - 4 * 0.22 * noise, row
        assert row["one_sided"] == 0, row
        assert abs(row["spread"] / row["standard_error"] - 1) < 4 * noise / 2**0.5, row
        assert abs(row["mean"] - 1) < 4 * row["standard_error"] * noise, row
    assert study_coverage.table(result).count("\n|") == 12
