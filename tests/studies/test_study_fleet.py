"""Reduced run of validation/study_fleet.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_fleet

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_a_fleet_raises_no_more_alarms_than_said_and_finds_what_is_far_off():
    result = study_fleet.run(reduced=True)
    assert study_fleet.table(result).count("\n|") == 2 + len(result["rows"]) + 2 + len(result["found"])
    for row in result["rows"]:
        # Shares of 5 % and 95 % scatter by 0.22 / √n; the test of several outliers at once takes a little more.
        noise = 4 * 0.22 / row["fleets"] ** 0.5
        assert row["alarm_0"] < 0.06 + noise, row
        assert all(row[f"{name}_covered"] > 0.93 - noise for name in ("mean", "spread", "further")), row
        assert row["spread2"] > 0.9 * row["spread"] ** 2, row
    for row in result["found"]:
        assert row["one_wrong"] < 0.05, row
        if row["off"] == 10 and row["units"] > 8:
            assert row["one_found"] > 0.95, row
