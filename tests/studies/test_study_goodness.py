"""Reduced run of validation/study_goodness.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_goodness

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_the_test_of_a_model_has_its_size_and_power():
    result = study_goodness.run(reduced=True)
    size = [row for row in result["rows"] if row["kind"] == "size"]
    assert {row["method"] for row in size} == {"asymptotic", "bootstrap"}
    for row in size:
        assert row["median"] > 0.05, row
        if row["method"] == "asymptotic":
            assert row["at_5"] < 0.05 + 4 * 0.22 / row["recordings"] ** 0.5, row
    strong, weak = (row for row in result["rows"] if row["kind"] == "power")
    assert strong["at_1"] > 0.9, strong
    assert weak["at_1"] < 0.5, weak
    assert study_goodness.table(result).count("\n|") == 2 + 5 + 2 + 2
