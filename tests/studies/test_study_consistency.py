"""Reduced runs of the studies of consistency and of ranges of scales."""

import pytest

from validation import study_consistency, study_scales

pytestmark = pytest.mark.slow


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
