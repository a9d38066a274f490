"""A reduced run of validation/study_monitor.py: its statements hold."""

import pytest

from validation import study_monitor

pytestmark = pytest.mark.slow


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
