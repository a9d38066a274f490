"""Reduced run of validation/study_likelihood.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_likelihood

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_intervals_by_likelihood_hold_the_truth():
    result = study_likelihood.run(reduced=True)
    assert study_likelihood.table(result).count("\n|") == 9
    for row in result["rows"]:
        if row["parameter"] != study_likelihood.LEVEL:
            # 20 recordings: fewer than 16 would come by chance once in a thousand times.
            assert row["covered"] >= 0.8, row
            assert abs(row["spread"] / row["standard_error"] - 1) < 0.5, row
        assert abs(row["bias"]) < 4, row
    for row in result["tests"]:
        assert abs(row["deviance"] - row["parameters"]) < 4 * (2 * row["parameters"] / result["recordings"]) ** 0.5, row
