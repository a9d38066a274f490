"""Reduced run of validation/study_timeseries.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_timeseries

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_intervals_of_autoregressions_hold_the_truth():
    result = study_timeseries.run(reduced=True)
    assert study_timeseries.table(result).count("\n|") == 2 + len(result["rows"])
    for row in result["rows"]:
        # 20 recordings: fewer than 16 would come by chance once in a thousand times.
        assert row["covered"] >= 0.8, row
        assert abs(row["median"] / row["truth"] - 1) < 0.05, row
