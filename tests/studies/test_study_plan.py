"""Reduced run of validation/study_plan.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_plan

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_fits_scatter_as_planned():
    result = study_plan.run(reduced=True)
    seen = [row for row in result["rows"] if row["plan"] <= 0.3]
    assert len(seen) == len(result["rows"]) == 9
    # The standard deviation of n normal numbers is known to 1 / √(2 n).
    for row in seen:
        assert abs(row["standard_deviation_over_plan"] - 1) < 4 / (2 * result["recordings"]) ** 0.5, row
    assert study_plan.table(result).count("\n|") == 11
