"""Reduced run of validation/study_covariance.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_covariance

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_the_covariance_is_what_recordings_scatter_by():
    result = study_covariance.run(reduced=True)
    assert study_covariance.table(result).count("\n|") == 64
    for row in result["rows"]:
        if row["estimator"] == "classical":
            assert abs(row["deviation"]) < 4, row
    for row in result["covariances"]:
        if row["estimator"] == "classical":
            assert row["largest"] < 4, row
