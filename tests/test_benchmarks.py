"""The benchmarks: the words that they check are there, the page says what was measured, and files are whole."""

from __future__ import annotations

import json
import re
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import __main__ as suite
from benchmarks import children, harness, page, recordings, scaling, targets
from benchmarks.bench_wavelet_variance import decimated, pyramid, stationary
from benchmarks.claims import CLAIMS, MARGIN, ROOT, Claim
from benchmarks.results import Results

RECORD = page.DOCUMENTS / f"{page.NAME}.json"

TOLD = re.compile(r"[0-9⁰-⁹] (?:ms|ns|MB|GB)\b|times as long|an? \w+th of [\w']+ time|1/[0-9]+ of the time")
"""How a figure of time or memory looks."""


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    return json.loads(RECORD.read_text(encoding="utf-8"))  # type: ignore[no-any-return]


def empty() -> dict[str, Any]:
    return {"machine": {}, "copy_bandwidth_bytes_per_s": 1e9, "timings": [], "curves": [], "children": [],
            "recordings": []}  # fmt: skip


# --- claims -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("claim", CLAIMS, ids=lambda claim: claim.words)
def test_a_claim_quotes_words_that_are_there(claim: Claim) -> None:
    assert claim.is_there(), f"{claim.file} no longer says {claim.words!r}: change benchmarks/claims.py with it"


def test_every_figure_of_the_section_on_speed_is_a_claim() -> None:
    text = " ".join((ROOT / "README.md").read_text(encoding="utf-8").split("## Speed")[1].split("\n## ")[0].split())
    for claim in sorted(CLAIMS, key=lambda claim: -len(claim.words)):
        text = text.replace(" ".join(claim.words.split()), "")
    assert TOLD.findall(text) == []


def test_the_record_measures_every_claim_and_keeps_it(record: dict[str, Any]) -> None:
    results = Results(record)
    found = {claim.words: (claim.said, claim.measured(results)) for claim in CLAIMS}
    assert {words: pair for words, pair in found.items() if pair[1] > MARGIN * pair[0]} == {}


def test_a_verdict_can_be_each() -> None:
    results = Results(empty())
    for value, verdict in ((2.3, "no"), (2.2, "yes"), (1.1, "yes, and more")):
        assert Claim("README.md", "", 2.0, "", lambda _, value=value: value).verdict(results) == verdict  # type: ignore[misc]
    assert not Claim("README.md", "no such words", 1.0, "", lambda _: 1.0).is_there()


# --- the page ---------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_the_page_is_that_of_the_record(record: dict[str, Any], tmp_path: Path) -> None:
    page.write(record, tmp_path)
    for ending in (".json", ".md"):
        written, kept = (folder / f"{page.NAME}{ending}" for folder in (tmp_path, page.DOCUMENTS))
        assert written.read_text(encoding="utf-8") == kept.read_text(encoding="utf-8")
    assert "<svg" in (tmp_path / f"{page.NAME}.svg").read_text(encoding="utf-8")


def test_a_record_of_any_length_takes_what_one_in_memory_takes(record: dict[str, Any]) -> None:
    results = Results(record)
    chunks, whole = "wavelet variance, in chunks", "wavelet variance, in memory"
    assert results.most(chunks) == results.child(chunks)["samples"] == 10**9
    assert results.per_sample(chunks, 10**9) < 2 * results.per_sample(whole, 10**7)
    assert results.child(chunks)["peak"] < 1e9


def test_nothing_is_written_where_something_is_missing(tmp_path: Path) -> None:
    with pytest.raises(LookupError, match="was the whole suite run"):
        page.write(empty(), tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_part_that_was_measured_again_takes_the_place_of_the_first() -> None:
    def found(*rows: tuple[str, float]) -> dict[str, Any]:
        timings = [{"module": "m", "name": name, "against": "a", "seconds": took} for name, took in rows]
        return empty() | {"timings": timings}

    joint = suite.renewed(found(("x", 1.0), ("y", 1.0)), found(("y", 2.0), ("z", 2.0)))
    assert joint == found(("x", 1.0), ("y", 2.0), ("z", 2.0))
    with pytest.raises(SystemExit, match="another machine"):
        suite.renewed(found(), found() | {"machine": {"processor": "another"}})


def test_no_page_without_the_whole_suite(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        suite.main(["--only", "robust", "--page"])
    assert "needs the whole suite" in capsys.readouterr().err


# --- what is compared -------------------------------------------------------------------------------------------------


def test_others_do_the_same_job() -> None:
    import gmwm

    x = np.random.default_rng(1).standard_normal(2**10)
    ours = gmwm.wavelet_variance(x, 1.0, levels=9).variance
    np.testing.assert_allclose(pyramid(x, 9), ours, rtol=1e-10)
    np.testing.assert_allclose(stationary(x, 9), ours, rtol=1e-10)
    np.testing.assert_allclose(
        decimated(x, 9), gmwm.wavelet_variance(x, 1.0, levels=9, transform="dwt").variance, rtol=1e-10
    )
    live = scaling.streamed(x[:100], 250)
    whole = gmwm.wavelet_variance(np.concatenate([x[:100], x[:100], x[:50]]), scaling.RATE)
    np.testing.assert_allclose(live.variance, whole.variance, rtol=1e-10)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_curves_and_cases_are_times_of_calls(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scaling, "BUDGET", 0.0)
    assert scaling.lengths(30_000) == [1000, 3000, 10_000, 30_000]
    curves = list(scaling.along_samples(3000, 1024))
    assert [curve.at for curve in curves] == [*6 * [(1000,)], (1024,), (1000, 3000), (1000,)]
    assert all(took > 0 for curve in curves for took in curve.seconds)
    calls: list[int] = []
    timing = harness.measure(harness.Case("ours", lambda: calls.append(1), "theirs", lambda: None, 3, 0.0), 1e9)
    assert len(calls) == 4
    assert "MISSED" in harness.table([timing])


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the resident set is read from /proc")
def test_memory_of_a_process_is_its_own() -> None:
    held = np.ones(20_000_000)  # of the parent, which a child must not be charged with
    child = children.run("x", "x = np.ones(10_000_000)", 10**7)
    assert held[0] == 1.0
    assert 0.9 * 80e6 < child.beyond < 1.3 * 80e6
    assert child.seconds > child.inside > 0
    with pytest.raises(RuntimeError, match="wrong"):
        children.run("y", "raise ValueError('wrong')")


# --- real recordings --------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_recordings_that_are_missing_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = []

    def inspect(name: str, arguments: list[str], samples: int, folder: Path) -> children.Child:
        words.append(arguments)
        if len(words) > 1:
            return children.run(name, f"gmwm.read({arguments[1]!r})", samples, folder)
        return children.command(name, ["info", arguments[1]], samples, folder)

    monkeypatch.setattr(recordings, "command", inspect)
    rows = [asdict(row) for row in recordings.recordings(tmp_path, samples=24_000, units=1, shapes=2)]
    assert [(first, *rest) for first, _, *rest in words] == [
        ("calibrate", "--output", f"results-{name}") for name in ("unit", "whole", "gaps")
    ]
    results = Results(empty() | {"recordings": rows})
    assert [row[:2] for row in recordings.rows_of_recordings(results)] == [
        ["slowest of 1 simulated units", "6×10⁴"],
        ["1 kHz, no sample lost", "10⁵"],
        ["1 kHz, 0.5 % of the samples lost", "10⁵"],
        ["slowest of 2 curves, 0 published", ""],
    ]
    assert all(row["seconds"] > 0 and row["peak"] > 1e7 for row in rows)
    asked = {target.work: target.found(results) for target in targets.TARGETS}
    assert [name for name, value in asked.items() if value is not None] == [
        "slowest of 30 simulated units with resonances and lines, the same",
        "slowest of 200 curves without samples, one axis, wall time",
        "log of 40 min at 1 kHz with 0.5 % lost samples, against the same without",
    ]


def test_the_times_of_other_programs_stand_without_a_run(record: dict[str, Any]) -> None:
    assert {row[-1] for row in recordings.rows_of_others(Results(empty()))} == {""}
    ours = [row[-1] for row in recordings.rows_of_others(Results(record))]
    assert len(ours) == len(recordings.OTHERS)
    assert ours.count("") == 1
