"""Reduced run of validation/study_optimism.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_optimism

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_the_optimism_is_what_simulation_says():
    result = study_optimism.run(reduced=True)
    assert [row["kind"] for row in result["rows"]] == ["right"] * 5 + ["weak"] * 2
    for row in result["rows"]:
        assert abs(row["asymptotic"] - row["optimism"]) < 4 * row["optimism_uncertain"], row
        assert row["asymptotic_low"] < row["asymptotic"] < row["asymptotic_high"], row
        if row["kind"] == "right":
            assert abs(row["asymptotic_at_truth"] - row["optimism"]) < 4 * row["optimism_uncertain"], row
        if row["kind"] == "right" and row["weighting"] == "optimal":
            # Two hundred draws of a chi-square of two degrees of freedom: 7 %; of two fits, each off by some 8 %: 6 %.
            assert abs(row["bootstrap"] / row["asymptotic_at_truth"] - 1) < 4 * 0.09, row
    optimal = {row["model"]: row["asymptotic_at_truth"] for row in result["rows"] if row["weighting"] == "optimal"}
    assert abs(optimal["AR1 + WN"] - 6) < 1e-6
    assert study_optimism.table(result).count("\n|") == 2 + 5 + 2 + 2
