"""Reduced run of validation/study_tails.py: tails are not taken for outliers, and outliers are."""

import pytest

from validation import study_tails

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_each_case_gets_its_curve():
    result = study_tails.run(reduced=True)
    for row in result["rows"]:
        # Some of the weakest knocks are left in a third of the short recordings.
        most = 0.5 if row["case"].startswith("knocks, 1 %") else 0.0
        assert row["robust"] <= most, row["case"]
        assert (row["replaced"] > 0) == (row["wanted"] == "replaced"), row["case"]
        if row["n"] is not None:
            assert row["n"] == pytest.approx(1.0, abs=0.03), row["case"]
    assert study_tails.table(result).count("\n|") == 2 + len(result["rows"])
