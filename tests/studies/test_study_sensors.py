"""Reduced run of validation/study_sensors.py, and the rules by which it counts."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from validation import sensors, study_sensors


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_the_family_itself_is_found() -> None:
    result = study_sensors.run(reduced=True)
    rows = {row["kind"]: row for row in result["rows"]}
    assert list(rows) == list(study_sensors.REDUCED)
    for kind in ("base", "flicker-weak"):
        # N of a filter includes some of the slow noise; a datasheet lists N of white noise only if it differs by 5 %.
        assert rows[kind]["N_ratio"] == pytest.approx(1, abs=0.05)
        assert rows[kind]["robust"] == rows[kind]["rejected"] == 0
    assert rows["agree-20s"]["alarms"] is not None
    assert rows["base"]["alarms"] is None
    assert study_sensors.table(result).count("\n|") == 2 + len(rows)


def entry(low: float, high: float | None, **other: Any) -> dict[str, Any]:
    return {"value": low, "low": low, "high": high, "limit": False, "term": None, "use": study_sensors.USE, **other}


def told(**other: Any) -> dict[str, Any]:
    truth = {"filter_N": 1.0, "filter_K": 2.0, "lowest": 3.0, "B": 5.0, "gm": [[1.0, 4.0]], "structure": "GM + WN + RW"}
    return {
        "truth": truth, "model": "WN + GM + RW", "equivalent": ["GM + WN", "2*GM + WN + RW"], "pvalue": 0.5,
        "robust": False, "codes": [], "numbers": {"N": entry(0.9, 1.1)}, **other,
    }  # fmt: skip


def scored(**numbers: dict[str, Any]) -> dict[str, Any]:
    return study_sensors.summarised("base", [told(numbers={"N": entry(0.9, 1.1), **numbers})])


def test_intervals_are_scored_by_what_the_number_means() -> None:
    assert scored()["N_covered"] == 1
    assert scored(K=entry(2.1, 2.2))["K_covered"] == 0
    # A limit is no interval, and a number that must not be used is neither.
    limit = scored(K=entry(0.0, 2.5, use=study_sensors.BOUND))
    assert (limit["K_covered"], limit["K_bound_holds"], limit["K_refused"]) == (None, 1, 0)
    refused = scored(K=entry(2.1, 2.2, use=study_sensors.DO_NOT_USE))
    assert (refused["K_covered"], refused["K_bound_holds"], refused["K_refused"]) == (None, None, 1)
    # B of a flicker term is its coefficient, and that of no term is the lowest point.
    assert scored(B=entry(2.9, 3.1))["B_covered"] == 1
    assert scored(B=entry(2.9, 3.1, term="FN"))["B_covered"] == 0
    assert scored(B=entry(4.9, 5.1, term="FN"))["B_covered"] == 1
    # q_c = √(2σ²/T_c), and only in a model with as many terms.
    assert scored(T_c=entry(3.9, 4.1), q_c=entry(0.7, 0.71))["q_c_covered"] == 1
    assert scored(**{"T_c[1]": entry(3.9, 4.1), "T_c[2]": entry(3.9, 4.1)})["T_c_scored"] == 0


def test_structures_are_compared_as_sums() -> None:
    row = study_sensors.summarised("base", [told()])
    assert (row["recommended"], row["in_set"], row["in_set_or_contains"]) == (1, 0, 1)
    assert study_sensors.summarised("base", [told(equivalent=["2*GM + WN + RW"])])["in_set_or_contains"] == 0
    assert study_sensors.summarised("base", [told(equivalent=["WN + RW + GM"])])["in_set"] == 1


def test_a_stopped_run_continues(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[int] = []

    def outcome(kind: str, repeat: int) -> dict[str, Any]:
        if repeat == 2 and len(done) == 2:
            done.append(-1)
            raise KeyboardInterrupt
        done.append(repeat)
        return {"repeat": repeat, "kind": kind}

    monkeypatch.setattr(study_sensors, "outcome", outcome)
    with pytest.raises(KeyboardInterrupt):
        study_sensors.measured(["base"], 4, folder=tmp_path)
    found = study_sensors.measured(["base"], 4, folder=tmp_path)
    assert [row["repeat"] for row in found["base"]] == [0, 1, 2, 3]
    assert done == [0, 1, -1, 2, 3]
    # Outcomes of other sources are measured again.
    monkeypatch.setattr(study_sensors, "_sources", lambda: "changed")
    study_sensors.measured(["base"], 1, folder=tmp_path)
    assert done[-1] == 0
    assert [json.loads(row)["repeat"] for row in (tmp_path / "base.jsonl").read_text().splitlines()] == [0]


def test_every_kind_has_its_place() -> None:
    assert len(set(study_sensors.ALL)) == len(sensors.KINDS) + len(sensors.PAIRS)
