"""Reduced run of validation/study_contamination_test.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_contamination, study_contamination_test

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_the_test_of_contamination_keeps_its_size():
    result = study_contamination_test.run(reduced=True)
    assert {row["rounding"] for row in result["rows"]} == {"none", "rate", "angle"}
    units = [row["units_alarmed"] for row in result["rows"]]
    axes = [row["axes_alarmed"] for row in result["rows"]]
    # A share of 5 % in n units scatters by 0.22 / √n.
    assert max(axes) < 0.05 + 4 * 0.22 / (6 * 20) ** 0.5
    assert sum(units) / len(units) < 0.05 + 4 * 0.22 / (20 * len(units)) ** 0.5
    found = {(row["outliers"], row["deviations"]): row for row in result["found"]}
    assert found["nothing", 0.0]["found"] < 0.2
    for kind in study_contamination.SPOILS:
        assert found[kind, 10.0]["found"] > 0.9, kind
        assert found[kind, 50.0]["excess"] > found[kind, 10.0]["excess"] > 0.1, kind
    assert study_contamination_test.table(result).count("\n|") == 2 + 8 + 1 + 2 + 13
