"""Reduced run of validation/study_efficiency.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_efficiency

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_optimal_weights_come_near_the_likelihood():
    result = study_efficiency.run(reduced=True)
    for row in result["theory"]:
        if row["moments"].startswith("haar"):
            # No unbiased estimate beats the bound, and optimal weights stay within a tenth of it.
            assert all(row[name] > 0.999 for name in ("GM.beta", "GM.sigma2", "WN.sigma2")), row
            assert "optimal" not in row["moments"] or row["GM.beta"] < 1.1, row
    for row in result["rows"]:
        assert abs(row["optimal_over_likelihood"] - 1) < 0.1 + 4 * row["optimal_uncertain"], row
    assert study_efficiency.table(result).count("\n|") == 11 + 26 + 8
