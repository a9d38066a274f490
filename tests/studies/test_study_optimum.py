"""Reduced run of validation/study_optimum.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_optimum

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_no_multistart_beats_a_fit():
    result = study_optimum.run(reduced=True)
    for row in result["rows"]:
        assert row["over_truth"] <= 1
        assert row["over_multistart"] <= 1 + 1e-9
        assert row["lower_bound"] >= 0.999 * row["objective"]
    assert study_optimum.table(result).count("\n|") == 12
