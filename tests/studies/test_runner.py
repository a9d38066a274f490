"""The runner of the statistical studies: records are repeatable, whole, and free of NaN."""

from __future__ import annotations

import json
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

import gmwm
from tests.helpers import each
from validation.__main__ import DOCUMENTS, find_studies, run_study, stored
from validation.pages import ROWS, appendix, page


def study(row: Any) -> ModuleType:
    module = ModuleType("study_of_tests")
    module.NAME, module.SEED = "of-tests", 7  # type: ignore[attr-defined]
    module.run = lambda reduced: {"rows": [row] * (1 if reduced else 3)}  # type: ignore[attr-defined]
    module.table = lambda result: f"{len(result['rows'])} rows. Two. Three. Four.\n\n| a |\n|---|\n" + "| 1 |\n" * 9  # type: ignore[attr-defined]
    return module


def test_a_record_says_what_it_was_made_with_and_no_more() -> None:
    record = run_study(study({"a": np.float64(0.1), "b": np.arange(2)}), reduced=True)
    content = json.loads(record.json)
    assert content["rows"] == [{"a": 0.1, "b": [0, 1]}]
    assert (content["study"], content["seed"], content["reduced"]) == ("of-tests", 7, True)
    assert content["versions"] == {"gmwm": gmwm.__version__, "numpy": np.__version__} | {
        "scipy": content["versions"]["scipy"]
    }
    assert set(content) == {"study", "reduced", "seed", "versions", "rows"}
    assert record.markdown.startswith("# of-tests\n\n1 rows. Two. Three.\n\n| a |\n|---|\n| 1 |\n")
    assert record.markdown.count("| 1 |") == ROWS
    assert "\n\nSeed 7;" in record.markdown
    assert record == run_study(study({"a": np.float64(0.1), "b": np.arange(2)}), reduced=True)


def test_a_record_is_written_as_both_files(tmp_path: Path) -> None:
    record = run_study(study(1.0))
    record.write(tmp_path)
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {
        "of-tests.json": record.json,
        "of-tests.md": record.markdown,
    }


def test_where_one_file_cannot_be_written_neither_is(tmp_path: Path) -> None:
    (tmp_path / "of-tests.md").mkdir()
    with pytest.raises(OSError, match=r"of-tests\.md"):
        run_study(study(1.0)).write(tmp_path)
    assert [file.name for file in tmp_path.iterdir()] == ["of-tests.md"]


@pytest.mark.parametrize("value", [float("nan"), np.array([1.0, np.inf])])
def test_nan_is_no_result(value: Any) -> None:
    with pytest.raises(ValueError, match="study of-tests has a NaN"):
        run_study(study(value))


def test_a_study_without_rows_is_an_error() -> None:
    empty = study(1.0)
    empty.run = lambda reduced: {"rows": []}  # type: ignore[attr-defined]
    with pytest.raises(ValueError, match="gave no rows"):
        run_study(empty)


def test_every_study_has_a_name_of_its_own() -> None:
    studies = find_studies()
    assert studies
    assert all(name == module.NAME for name, module in studies.items())


@each("name", [name for name in find_studies() if (DOCUMENTS / f"{name}.json").is_file()])
def test_a_page_is_that_of_its_record(name: str) -> None:
    # After a change of a table or of its words: python -m validation --pages
    module = find_studies()[name]
    assert page(module, stored(module)) == (DOCUMENTS / f"{name}.md").read_text(encoding="utf-8")
    assert len(page(module, stored(module)).split()) < 600
    assert "|---|" in appendix(module, stored(module))
