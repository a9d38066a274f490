"""Reduced run of validation/study_tracks.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_tracks

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_tracks_say_how_far_off_they_are(tmp_path):
    result = study_tracks.run(reduced=True)
    assert study_tracks.table(result).count("\n|") == 2 + len(result["rows"]) == 8
    for row in result["rows"]:
        # Six records scatter more than they know of themselves.
        assert abs(row["covered"] - 0.95) < 0.02 + 6 * row["covered_uncertain"], row
        assert abs(row["error"] / row["said"] - 1) < 0.1, row
        assert row["gap_covered"] > 0.85, row
        assert row["gap_said"] > 1.3 * row["said"], row
        assert abs(row["over_true"] - 1) < 0.05, row
        assert row["rejected"] <= 0.5, row
    errors = {(row["parameters"], row["kind"]): row["error"] for row in result["rows"]}
    assert all(errors[name, "smooth"] < 0.85 * errors[name, "filter"] for name in study_tracks.PARAMETERS)
    study_tracks.draw(result, tmp_path / "tracks.svg")
    assert (tmp_path / "tracks.svg").read_bytes().startswith(b"<?xml")
