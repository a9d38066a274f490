"""Reduced run of validation/study_weighting.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_weighting

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_weightings_differ_where_the_record_of_them_says_so():
    result = study_weighting.run(reduced=True)
    assert all(row["diagonal"] > 0.999 and row["identity"] > 0.999 for row in result["theory"])
    for row in result["rows"]:
        if row["parameter"] == "WN.sigma2" and row["case"] in ("right", "rounding left out"):
            for weighting in ("diagonal", "optimal"):
                # The white noise is known to 0.5 %; rounding left out goes into it.
                off = abs(row[f"{weighting}_median"] - 1)
                assert off < 0.03 if row["case"] == "right" else off > 0.1, row
    assert study_weighting.table(result).count("\n|") == 34 + 30
