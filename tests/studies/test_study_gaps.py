"""Reduced run of validation/study_gaps.py: filling is unbiased, and its intervals hold."""

import numpy as np
import pytest

from validation import study_gaps

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_the_estimator_of_pairs_is_that_of_the_coefficients_without_losses():
    x = np.random.default_rng(1).normal(size=50_000)
    found = study_gaps.by_pairs(x, np.ones(x.size, dtype=bool))
    assert found[:6] == pytest.approx(study_gaps.curve(x)[:6], rel=5e-3)


def test_filled_recordings():
    result = study_gaps.run(reduced=True)
    for row in result["rows"]:
        if row["way"] == "filled":
            assert abs(row["levels"]["1"][0]) < 0.02
    for test in result["tests"]:
        assert test["n"] == pytest.approx(1.0, abs=0.03)
        assert min(test["covered"].values()) >= 0.5
    assert study_gaps.table(result).count("\n|") == 4 + len(result["rows"]) + len(result["tests"])
