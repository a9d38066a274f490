"""Reduced run of validation/study_contamination.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_contamination

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_robust_fits_recover_from_knocks():
    result = study_contamination.run(reduced=True)
    assert study_contamination.table(result).count("\n|") == 29
    for row in result["rows"]:
        if row["outliers"] == "knocks" and row["estimator"].startswith("robust"):
            assert row["recovered"] >= 0.8, row
            assert row["low"] <= row["median"] <= row["high"], row
        elif row["parameter"] == "WN.sigma2" and row["estimator"] == "classical":
            assert row["recovered"] == 0, row
            assert row["median"] > 2, row
