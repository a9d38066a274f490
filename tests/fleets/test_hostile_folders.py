"""Folders with files that are no recordings: pipes, names that are not UTF-8, documents that are damaged."""

import json
import os
import sys
from pathlib import Path

import pytest

import gmwm
from gmwm import Calibration, calibrate, fleet, simulate
from gmwm.applications.fleets import Fleet
from gmwm.applications.fleets.result import FORMAT, find_units, read_facts
from gmwm.base.atomic_files import DEEPEST_DOCUMENT, read_json
from gmwm.base.errors import OptionError, ReadError
from gmwm.files.formats.parquet import ParquetReader
from gmwm.files.formats.text import TextReader
from gmwm.recording.options import ReadOptions
from tests.helpers import raises

DEEP = "[" * 100_000


def recording(path, rng=1):
    simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=2000, rng=rng).write(path)
    return path


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
@pytest.mark.parametrize("pattern", [None, "*.csv", "*"])
def test_a_pipe_is_not_a_recording(tmp_path, pattern):
    recording(tmp_path / "unit.csv")
    for name in ("pipe.csv", "pipe"):
        os.mkfifo(tmp_path / name)
    (tmp_path / "zero.csv").symlink_to("/dev/zero")
    units = find_units(tmp_path, tmp_path / "out", pattern)
    assert list(units.paths) == ["unit.csv"]
    assert units.left_out == ("pipe", "pipe.csv", "zero.csv")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")
def test_the_summary_names_what_is_no_recording(tmp_path):
    recording(tmp_path / "unit.csv")
    os.mkfifo(tmp_path / "pipe.csv")
    found = fleet(tmp_path, tmp_path / "out", within="WN", workers=0)
    assert "No recordings, left out (1 file):\n- pipe.csv" in found.summary()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="the system has no permissions of Unix")
def test_a_folder_that_cannot_be_listed_is_an_error(tmp_path, monkeypatch):
    recording(tmp_path / "unit.csv")
    closed = tmp_path / "lot 2"
    closed.mkdir()
    listed = os.scandir

    def scandir(path):
        if str(path) == str(closed):  # root may list any folder
            raise PermissionError(13, "Permission denied", str(path))
        return listed(path)

    monkeypatch.setattr(os, "scandir", scandir)
    with raises(OptionError, closed, "Permission denied", argument="recordings"):
        find_units(tmp_path, tmp_path / "out", None)


def test_a_folder_that_cannot_be_entered_is_an_error(tmp_path, monkeypatch):
    """Its files can be listed, but nothing else can be known about them."""
    recording(tmp_path / "unit.csv")
    closed = recording(tmp_path / "other.csv")
    stat = os.stat

    def refused(path, *given, **options):
        if str(path) == str(closed):
            raise PermissionError(13, "Permission denied", str(path))
        return stat(path, *given, **options)

    monkeypatch.setattr(os, "stat", refused)
    monkeypatch.setattr(Path, "stat", refused)  # Python 3.10 keeps the function that os had
    with raises(OptionError, closed, "Permission denied", argument="recordings"):
        find_units(tmp_path, tmp_path / "out", None)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="the file system accepts UTF-8 only")
def test_names_that_are_not_utf8(tmp_path):
    folder = tmp_path / "units"
    folder.mkdir()
    path = folder / os.fsdecode(b"unit \xff.parquet")
    recording(folder / "other.parquet").rename(path)
    recording(folder / "plain.parquet")
    out = tmp_path / os.fsdecode(b"out \xff")
    found = fleet(folder, out, within="WN", workers=0)
    assert (found.units, found.failed) == (("plain.parquet", "unit \\xff.parquet"), {})
    again = Fleet.load(out)
    assert again.table.equals(found.table)
    names = ("plain.parquet", path.name)
    assert again.paths == {unit: str(folder / name) for unit, name in zip(found.units, names, strict=True)}
    assert again["unit \\xff.parquet"].recording.file == path.name
    one = calibrate(gmwm.read(path), within="WN")
    one.save(tmp_path / os.fsdecode(b"calibration \xff.json"))
    one.report(tmp_path / "report.html")
    assert "\\xff.parquet" in one.summary()
    with raises(ReadError, "\\xff"):
        gmwm.read(tmp_path / os.fsdecode(b"missing \xff.csv"))


LIMIT = "[" * (DEEPEST_DOCUMENT + 1) + "]" * (DEEPEST_DOCUMENT + 1)


@pytest.mark.parametrize(
    "text",
    [
        DEEP,
        '{"a":' * 100_000,
        LIMIT,
        "",
        "nul",
        "\xff",
        '{"a": [1e400]}',
        '{"a": NaN}',
        "[-Infinity]",
        "[1" + "0" * 400 + "]",
    ],
)
def test_documents_that_are_not_json_are_errors(tmp_path, text):
    (tmp_path / "fleet.json").write_bytes(text.encode("latin-1"))
    with pytest.raises(ValueError):  # noqa: PT011
        read_json(tmp_path / "fleet.json")
    with raises(ReadError, "fleet.json"):
        Fleet.load(tmp_path)
    with raises(ReadError, "fleet.json"):
        Calibration.load(tmp_path / "fleet.json")


@pytest.mark.parametrize(
    ("part", "value"), [("units", {"a": 1}), ("units", []), ("left_out", [None]), ("settings", 1), ("reading", None)]
)
def test_wrong_types_in_the_file_of_a_fleet_are_errors(tmp_path, part, value):
    whole = {"format": FORMAT, "version": 1, "settings": {}, "units": {}, "left_out": [], "reading": {}}
    (tmp_path / "fleet.json").write_text(json.dumps(whole))
    assert read_facts(tmp_path) == whole
    (tmp_path / "fleet.json").write_text(json.dumps(whole | {part: value}))
    with raises(ReadError, part):
        read_facts(tmp_path)


@pytest.mark.slow
def test_a_damaged_result_of_a_unit_is_made_again(tmp_path):
    folder = tmp_path / "units"
    folder.mkdir()
    recording(folder / "unit.parquet")
    fleet(folder, tmp_path / "out", within="WN", workers=0)
    stored = tmp_path / "out" / "units" / "unit.parquet.json"
    whole = json.loads(stored.read_text())
    for damage in (DEEP, "", "[]", json.dumps(whole | {"fleet": 1}), json.dumps(whole | {"recording": []})):
        stored.write_text(damage)
        found = fleet(folder, tmp_path / "out", within="WN", workers=0)
        assert (found.kept, found.done, found.failed) in ((0, 1, {}), (1, 0, {}))
        assert len(found) == 1


def test_the_process_of_the_user_does_not_decode_parquet(tmp_path, monkeypatch):
    # For some damaged files, Polars ends the process. Only a worker process may end.
    recording(tmp_path / "a.parquet")
    monkeypatch.setattr(ParquetReader, "layouts", lambda *_: pytest.fail("the file was opened"))
    assert set(find_units(tmp_path, tmp_path / "out", None).by_topic(ReadOptions()).paths) == {"a.parquet"}


def test_an_error_of_a_library_does_not_end_the_search(tmp_path, monkeypatch):
    (tmp_path / "a.csv").write_text("time [s],gyro_x [rad/s]\n" + "".join(f"{k / 100},0.1\n" for k in range(100)))
    monkeypatch.setattr(TextReader, "layouts", lambda *_: 1 / 0)
    assert set(find_units(tmp_path, tmp_path / "out", None).by_topic(ReadOptions()).paths) == {"a.csv"}
