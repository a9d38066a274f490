"""Reduced run of validation/study_starts.py: its statements hold within the scatter of the run."""

import pytest

from validation import study_starts

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")]


def test_random_starts_never_beat_the_convex_route():
    result = study_starts.run(reduced=True)
    assert study_starts.table(result).count("\n|") == 2 + len(result["rows"])
    for row in result["rows"]:
        assert row["least"] >= 1 - 1e-6, row
        if row["start"] == "exact values":
            assert row["worst"] <= 1 + 1e-6, row
