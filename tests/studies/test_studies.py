"""Reduced runs of the other studies: their statements hold within the scatter of the run."""

import numpy as np
import pytest

from validation import (
    study_budget,
    study_consistency,
    study_dynamics,
    study_missing,
    study_moments,
    study_monitor,
    study_recordings,
    study_rest,
    study_rounding,
    study_scales,
    study_trends,
)

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


def test_a_filter_of_the_true_noise_is_consistent():
    rows = study_consistency.run(reduced=True)["rows"]
    assert [row["verdicts"]["overconfident"] for row in rows[:3]] == [0.0] * 3
    assert rows[0]["ratio"] == pytest.approx(1, abs=0.03)
    assert rows[5]["verdicts"]["overconfident"] == 1.0


def test_a_range_of_scales_has_the_smallest_mean_of_its_gain(tmp_path):
    result = study_scales.run(reduced=True)
    short, long, both = result["rows"]
    assert 1.0 <= both["goal"] / both["best"] < 1.02
    assert both["goal"] <= min(short["goal"], long["goal"])
    study_scales.draw(result, tmp_path / "scales.svg")


def test_parameters_follow_a_moving_condition(tmp_path):
    result = study_dynamics.run(reduced=True)
    # Of 19 intervals at 95 %, five or more miss by chance in one of 500 runs.
    assert np.mean([share for row in result["rows"] for share in row["covered"]]) > 0.75
    certain = {row["name"] for row in result["rows"] if row["change"] == [1.0, 1.0]}
    assert certain >= {"WN on ramps", "AR1, irregular", "AR1, quick", "GM, irregular"}
    study_dynamics.draw(result, tmp_path / "dynamics.svg")
    assert "AR1, quick" in (tmp_path / "dynamics.svg").read_text(encoding="utf-8")


def test_gaps_cost_only_their_days():
    rows = study_missing.run(reduced=True)["rows"]
    assert all(0.2 < row["ratio"] < 2.5 for row in rows)
    assert rows[0]["covered"] >= 0.6


def test_intervals_of_more_moments_contain_the_truth():
    result = study_moments.run(reduced=True)
    assert all(min(row["covered"]) >= 0.5 for row in result["rows"])
    assert study_moments.table(result).count("\n|") == 7


def test_alarms_of_good_sensors_are_as_rare_as_wanted_and_faults_are_named():
    result = study_monitor.run(reduced=True)
    plain = [row for row in result["lengths"] if not row["baseline"]]
    (with_baseline,) = (row for row in result["lengths"] if row["baseline"])
    # One alarm is expected in 10⁶ samples: 4 in all, and fewer with a baseline.
    assert 1 <= sum(row["alarms"] for row in plain) <= 11
    assert with_baseline["alarms"] <= 3
    assert [(row["ratios"], row["blocks"]) for row in result["charts"]] == list(study_monitor.CHARTS)
    for row in result["rows"]:
        assert row["found"] == 1.0
        assert row["right"] == 1.0
        assert row["median"] < 300
    assert study_monitor.table(result).count("\n|") == 2 + len(result["lengths"]) + 2 + len(result["rows"]) + 2 + 3


def test_sizes_powers_and_coverage():
    result = study_recordings.run(reduced=True)
    assert {row["kind"] for row in result["rows"]} == set(study_recordings.MODELS)
    # Of 10 equal recordings each, 5 % are rejected.
    assert all(row["both"] <= 0.4 and row["fit"] <= 0.4 for row in result["rows"])
    strong = next(row for row in result["powers"] if row["what"] == "γ² ± 80 %")
    assert strong["both"] > 0
    for row in result["intervals"]:
        assert row["covered"] > 0.88, row  # of 200 at 95 %
        assert row["without"] <= row["covered"] + 0.01
    assert study_recordings.table(result).count("\n| ") > 35


def test_the_interval_of_the_model_holds_the_bias():
    result = study_rest.run(reduced=True)
    white, walk = result["rows"]
    # Of 24 intervals at 95 %, fewer than 19 hold once in a thousand times.
    assert min(white["covered"], walk["covered"]) > 0.78
    assert walk["naive"] < 0.5
    assert study_rest.table(result).count("\n|") == 2 + 2


def test_a_warm_up_is_found_and_noise_is_not():
    result = study_trends.run(reduced=True)
    *nulls, warm = result["rows"]
    assert [row["found"] for row in nulls] == [0.0, 0.0]
    assert (warm["size"], warm["found"], warm["warm_up"]) == (206.0, 1.0, 1.0)
    assert warm["median_size"] == pytest.approx(206, rel=0.1)
    assert warm["walk_limit"] < 0.2 * warm["walk_with"]
    assert study_trends.table(result).count("\n|") == 7


def test_small_steps_add_white_noise():
    result = study_rounding.run(reduced=True)
    for row in result["rows"]:
        assert row["sheppard"] == pytest.approx(1, abs=0.02)
        assert row["gain"] == pytest.approx(1, abs=0.15)
        assert row["estimate"] == pytest.approx(1, abs=0.05)
    assert [row["remark"] for row in result["rows"]] == ["", "output-rounded"]
    assert study_rounding.table(result).count("\n|") == 4
