"""Reduced runs of validation/study_trends.py and study_rounding.py: their statements hold."""

import pytest

from validation import study_rounding, study_trends

pytestmark = pytest.mark.slow


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
