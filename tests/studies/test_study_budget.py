"""Reduced run of validation/study_budget.py: the budget has the errors of a strapdown integration."""

import numpy as np
import pytest

from validation import study_budget

pytestmark = pytest.mark.slow


def test_every_error_is_that_of_the_integration():
    result = study_budget.run(reduced=True)
    assert {row["model"] for row in result["rows"]} == set(study_budget.MODELS)
    assert len(result["rows"]) == 2 * 5 * len(study_budget.MODELS)
    for row in result["rows"]:
        # 50 ratios: four standard errors, of which the root mean square of few runs has no normal distribution.
        assert abs(row["ratio"] - 1) < 4.5 * row["error"], row
    assert study_budget.table(result).count("\n| ") == 2 * len(study_budget.MODELS) + 1


def test_the_integration_of_no_noise_stays_at_rest():
    none = study_budget.navigate(("WN(sigma2=0)", "WN(sigma2=0)"), 1, 0, (1, 10), np.random.default_rng(1))
    for errors in none.values():
        assert max(abs(value).max() for value in errors.values()) < 1e-6
