"""Reduced runs of the studies of moving conditions and of gaps."""

import numpy as np
import pytest

from validation import study_dynamics, study_missing

pytestmark = pytest.mark.slow


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
