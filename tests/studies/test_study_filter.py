"""Reduced run of validation/study_filter.py: filters with N and K on simulated noise err as they state."""

import pytest

from validation import study_filter

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]

FORGOTTEN = {"GM 50, 1 s", "GM 50, 15 s"}
"""Noise with a correlation time below the longest prediction, which a random walk cannot describe."""


def test_filters_predict_well_and_state_their_error():
    result = study_filter.run(reduced=True)
    assert [row["noise"] for row in result["rows"]] == list(study_filter.MODELS)
    for row in result["rows"]:
        assert row["claim"][0] == pytest.approx(1.0, abs=0.03), row
        assert max(row["loss"][:2]) < 1.03, row
        if row["noise"] not in FORGOTTEN:
            assert row["loss"][2] < 1.13, row
            assert all(0.8 < claim < 1.3 for claim in row["claim"]), row
        # A Gauss-Markov bias cures the exceptions.
        assert max(row["state"]) < 1.06, row
        assert all(0.75 < claim < 1.3 for claim in row["state_claim"]), row
        assert min(row["full"]) > 0.85, row
    for row in result["coverage"]:
        # Four standard errors of 40 fits.
        assert min(row["N"], row["K"]) > 0.95 - 4 * 0.035, row
    assert study_filter.table(result).count("\n| ") == len(study_filter.MODELS) + len(study_filter.COVERED) + 2
