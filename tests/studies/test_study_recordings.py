"""Reduced run of validation/study_recordings.py: the tests of equal recordings, and intervals with their spread."""

import pytest

from validation import study_recordings

pytestmark = pytest.mark.slow


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
