"""A reduced run of the study of moments at lags."""

import pytest

from validation import study_moments

pytestmark = pytest.mark.slow


def test_intervals_of_more_moments_contain_the_truth():
    result = study_moments.run(reduced=True)
    assert all(min(row["covered"]) >= 0.5 for row in result["rows"])
    assert study_moments.table(result).count("\n|") == 7
