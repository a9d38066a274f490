"""Reduced run of validation/study_adis16405.py, if the recordings are there."""

import pytest

from validation import study_adis16405

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not study_adis16405.DATA.exists(), reason="the recordings of shared/data are not here"),
]


def test_the_table_and_the_picture(tmp_path):
    result = study_adis16405.run(reduced=True)
    assert {row["axis"] for row in result["rows"]} == set(study_adis16405.AXES)
    assert study_adis16405.table(result).count("\n| ") == len(result["rows"]) + 1
    study_adis16405.draw(result, tmp_path / "adis.svg")
    assert (tmp_path / "adis.svg").stat().st_size > 10_000
