"""A fleet: every unit calibrated once, whatever happens to files, workers and runs."""

import errno
import json
import os
import signal

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm import Calibration, GmwmError, calibrate, fleet, read, simulate
from gmwm.applications.fleets import Fleet, unit_job
from gmwm.applications.fleets.engine import Cluster, Here, allowing_lost_workers, run_jobs
from gmwm.applications.fleets.result import find_units
from gmwm.applications.fleets.unit_job import RUN_AGAIN, UnitJob, UnitOptions, UnitOutcome
from gmwm.base.errors import DataError, GmwmWarning, OptionError, ReadError
from gmwm.calibration.options import CalibrationOptions
from gmwm.files.readers.api import read_file
from gmwm.recording.options import ReadOptions
from tests.helpers import code_of, raises

pytestmark = pytest.mark.slow

WITHIN = "WN + RW"
ONE = {"gyro_x": "WN(sigma2=4e-7)"}
TWO = ONE | {"gyro_y": "WN(sigma2=4e-7) + RW(gamma2=1e-9)"}
UNITS = 28
TWOFOLD = 7
"""The unit with two axes."""
BAD = ("lot 0/unit 013.parquet", "lot 1/unit 020.csv")


def made(path, seed, samples=2000, models=ONE):
    path.parent.mkdir(parents=True, exist_ok=True)
    simulate(models, rate=100.0, samples=samples, rng=seed).write(path)
    return path


def spoilt(path):
    """Whole up to the midst, zeros from there on, as after a loss of power."""
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2] + bytes(len(content) // 2))


def name_of(k):
    return f"lot {k // 14}/unit {k:03d}{'.csv' if k % 4 == 0 else '.parquet'}"


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """Small recordings, two of them corrupt, and files that are none."""
    folder = tmp_path_factory.mktemp("recordings")
    for k in range(UNITS):
        made(folder / name_of(k), seed=k, models=TWO if k == TWOFOLD else ONE)
    for unit in BAD:
        spoilt(folder / unit)
    (folder / ".hidden.csv").write_text("not for us")
    (folder / "photo.jpg").write_bytes(b"\xff\xd8\xff\xe0" + bytes(range(64)))
    (folder / "notes.md").write_text("# Units 0 to 27\n")
    return folder


@pytest.fixture
def few(tmp_path):
    """Six small recordings."""
    for k in range(6):
        made(tmp_path / "in" / f"{k}.parquet", seed=k)
    return tmp_path / "in"


@pytest.fixture(scope="module")
def client():
    """Two worker processes; the scheduler gives a job up with the second worker that it loses."""
    distributed = pytest.importorskip("distributed")
    with (
        allowing_lost_workers(1),
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield client


@pytest.fixture(scope="module")
def run(recordings, client, tmp_path_factory):
    """The fleet, a worker killed half-way."""
    output, told = tmp_path_factory.mktemp("output") / "results", []
    workers = list(client.run(os.getpid).values())

    def progress(done, units, text):
        told.append((done, units, text))
        if len(told) == units // 2:
            os.kill(workers[0], signal.SIGKILL)

    found = fleet(recordings, output, within=WITHIN, scheduler=client, progress=progress)
    assert workers != list(client.run(os.getpid).values())
    return found, output, told


def stamps(output):
    return {path: path.stat().st_mtime_ns for path in (output / "units").rglob("*.json")}


# --- the fleet that must not lose anything ----------------------------------------------------------


def test_all_good_units_are_calibrated_once_and_the_bad_ones_told(run, recordings):
    found, output, told = run
    good = {name_of(k) for k in range(UNITS)} - set(BAD)
    assert (found.done, found.kept, len(found)) == (UNITS - 2, 0, UNITS - 2)
    assert set(found) == good
    assert set(found.failed) == set(BAD)
    assert all(found.failed.values())
    assert found.left_out == ("notes.md", "photo.jpg")
    # Each once: told once, a row for each axis, a file.
    assert [done for done, _, _ in told] == list(range(1, UNITS + 1))
    assert {text.removesuffix(": failed") for _, _, text in told} == good | set(BAD)
    counts = found.table.group_by("unit").len()
    assert dict(counts.iter_rows()) == dict.fromkeys(good | set(BAD), 1) | {name_of(TWOFOLD): 2}
    files = {path.relative_to(output / "units").as_posix() for path in stamps(output)}
    assert files == {f"{unit}.json" for unit in good}


def test_what_a_worker_finds_is_what_calibrate_finds(run, recordings):
    found, _, _ = run
    for unit in (name_of(0), name_of(TWOFOLD)):
        expected = calibrate(read(recordings / unit), WITHIN).of_file(recordings / unit)
        assert found[unit].to_dict() == expected.to_dict()


def test_the_table_holds_the_numbers(run):
    found, output, _ = run
    unit = name_of(TWOFOLD)
    one = found[unit]
    rows = {row["axis"]: row for row in found.table.filter(pl.col("unit") == unit).to_dicts()}
    assert list(rows) == list(one.axes)
    for axis, row in rows.items():
        assert (row["status"], row["reason"], row["model"]) == ("calibrated", None, one[axis].model.structure)
        assert (row["samples"], row["rate"], row["duration"]) == (2000, 100.0, 20.0)
        assert row["sha256"] == one.recording.sha256
        assert row["p_value"] == one.axes[axis].test.pvalue
        assert (row["robust"], row["certified"]) == (False, True)
        sheet = one.datasheets[axis]
        for symbol in {column.removesuffix("_unit") for column in row if column.endswith("_unit")}:
            entry = sheet.get(symbol)
            if entry is None:
                expected = (None, None, None, None)
            elif entry.upper_only:
                expected = (None, 0.0, entry.high, entry.unit)
            else:
                expected = (entry.value, entry.low, entry.high, entry.unit)
            assert tuple(row[f"{symbol}{end}"] for end in ("", "_low", "_high", "_unit")) == expected
        assert row["N_unit"] == "rad/s/√Hz"
    bad = found.table.filter(pl.col("unit") == BAD[0]).to_dicts()[0]
    assert (bad["axis"], bad["status"], bad["reason"]) == (None, "failed", found.failed[BAD[0]])
    assert pl.read_parquet(output / "fleet.parquet").equals(found.table)


def test_a_fleet_is_loaded_as_it_was(run):
    found, output, _ = run
    again = Fleet.load(output)
    assert again.table.equals(found.table)
    assert (again.units, again.failed, again.left_out) == (found.units, found.failed, found.left_out)
    assert (again.settings, again.kept, again.done) == (found.settings, UNITS - 2, 0)
    assert again[name_of(1)].to_dict() == found[name_of(1)].to_dict()
    with raises(DataError, BAD[0]):
        again[BAD[0]]
    with raises(OptionError, argument="unit", got="unit 7"):
        again["unit 7"]


def test_a_second_run_does_what_failed_and_nothing_else(run, recordings):
    _, output, _ = run
    before = stamps(output)
    made(recordings / BAD[0], seed=13)
    try:
        found = fleet(recordings, output, within=WITHIN, workers=0)
    finally:
        spoilt(recordings / BAD[0])
    assert (found.kept, found.done) == (UNITS - 2, 1)
    assert set(found.failed) == {BAD[1]}
    after = stamps(output)
    assert {path: after[path] for path in before} == before
    assert len(after) == UNITS - 1


def test_a_unit_that_kills_its_workers_fails_and_takes_nobody_along(client, few):
    class Deadly(int):
        def __lt__(self, other):
            os._exit(9)  # when calibrate looks at its number of threads, in a worker

    asked = asked_for(WITHIN)
    jobs = [UnitJob(path.name, str(path), asked, 1) for path in sorted(few.iterdir())]
    jobs.insert(2, UnitJob("deadly", jobs[0].path, asked, Deadly(1)))
    with Cluster(client) as cluster:
        outcomes = list(run_jobs(jobs, cluster, retries=1))
    assert sorted(one.unit for one in outcomes) == sorted(job.unit for job in jobs)
    assert [one.unit for one in outcomes if one.document is None] == ["deadly"]
    assert "its worker process died" in next(one.reason for one in outcomes if one.unit == "deadly")


def test_this_process_does_something_else_once_while_jobs_run():
    done = []

    class Place(Here):
        def begin(self, job):
            done.append(f"begin {job.unit}")
            super().begin(job)

        def answers(self):
            return [(self._job, UnitOutcome(self._job.unit))]

    jobs = [UnitJob(name, name, asked_for(WITHIN)) for name in ("one", "two")]
    outcomes = run_jobs(jobs, Place(), retries=0, meanwhile=lambda: done.append("other work"))
    assert [outcome.unit for outcome in outcomes] == ["one", "two"]
    assert done == ["begin one", "other work", "begin two"]


def asked_for(within):
    return UnitOptions(CalibrationOptions(within=within), ReadOptions())


# --- what is kept, and what is done anew ------------------------------------------------------------


def test_what_is_asked_for_otherwise_is_done_anew(few, tmp_path):
    output = tmp_path / "out"
    for k in range(2, 6):
        (few / f"{k}.parquet").unlink()
    assert fleet(few, output, within=WITHIN, workers=0).done == 2
    assert fleet(few, output, within=WITHIN, workers=0, reading={"rate": None, "skip": []}).kept == 2
    changes = ({"within": "WN"}, {"confidence": 0.9}, {"axes": "gyro_x"}, {"reading": {"start": 5.0}})
    for change in changes:
        options = {"within": WITHIN, "workers": 0} | change
        assert fleet(few, output, **options).done == 2, change
        assert fleet(few, output, **options).kept == 2, change


def test_another_recording_is_done_anew_a_touched_one_is_not(few, tmp_path):
    def fixed(name, seed):
        values = simulate(ONE, rate=100.0, samples=2000, rng=seed)["gyro_x"].values.tolist()
        rows = "".join(f"{k / 100:05.2f},{value:+.12e}\n" for k, value in enumerate(values))
        (few / name).write_text("time [s],gyro_x [rad/s]\n" + rows)
        return (few / name).stat().st_size

    output = tmp_path / "out"
    size = fixed("6.csv", seed=6)
    assert fleet(few, output, within=WITHIN, workers=0).done == 7
    os.utime(few / "1.parquet", ns=(1, 1))
    made(few / "3.parquet", seed=3, samples=3000)
    (few / "4.parquet").unlink()
    made(few / "new" / "4.parquet", seed=4)
    assert fixed("6.csv", seed=7) == size
    with pytest.warns(GmwmWarning) as warned:
        found = fleet(few, output, within=WITHIN, workers=0)
    (remark,) = (one.message.remark for one in warned if isinstance(one.message, GmwmWarning))
    facts = {"folder": str(output / "units"), "count": 1, "units": ("4.parquet",)}
    assert (code_of(remark), remark.facts) == ("other-results:units", {"case": "units", **facts})
    assert (found.kept, found.done) == (4, 3)
    samples = dict(found.table.select("unit", "samples").iter_rows())
    units = [*(f"{k}.parquet" for k in (0, 1, 2, 3, 5)), "6.csv", "new/4.parquet"]
    assert samples == {unit: 3000 if unit == "3.parquet" else 2000 for unit in units}
    expected = calibrate(read(few / "6.csv"), WITHIN)
    assert found["6.csv"]["gyro_x"].parameters == expected["gyro_x"].parameters


def test_a_result_that_is_spoilt_is_made_anew(few, tmp_path):
    output = tmp_path / "out"
    fleet(few, output, within=WITHIN, workers=0)
    file = output / "units" / "5.parquet.json"
    whole = file.read_bytes()
    for spoil in (whole[: len(whole) // 2], b"", b"[]", json.dumps({"format": "gmwm-calibration"}).encode()):
        file.write_bytes(spoil)
        assert fleet(few, output, within=WITHIN, workers=0).done == 1
        assert file.read_bytes() == whole


def test_a_result_goes_when_its_recording_can_no_longer_be_calibrated(few, tmp_path):
    output = tmp_path / "out"
    fleet(few, output, within=WITHIN, workers=0)
    spoilt(few / "0.parquet")
    found = fleet(few, output, within=WITHIN, workers=0)
    assert list(found.failed) == ["0.parquet"]
    assert not (output / "units" / "0.parquet.json").exists()


def test_ctrl_c_keeps_what_is_done(few, tmp_path):
    output = tmp_path / "out"

    def interrupt(done, units, text):
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet(few, output, within=WITHIN, workers=0, progress=interrupt)
    found = Fleet.load(output)
    assert (found.kept, len(found.failed)) == (3, 3)
    assert all("the run ended before" in why for why in found.failed.values())
    found = fleet(few, output, within=WITHIN, workers=0)
    assert (found.kept, found.done, found.failed) == (3, 3, {})


def test_ctrl_c_leaves_a_cluster_without_work(client, few, tmp_path):
    def interrupt(done, units, text):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fleet(few, tmp_path / "out", within=WITHIN, scheduler=client, progress=interrupt)
    found = fleet(few, tmp_path / "out", within=WITHIN, scheduler=client)
    assert (found.kept, found.done) == (1, 5)


def test_a_scheduler_that_goes_away_ends_the_fleet_and_loses_nothing(few, tmp_path):
    distributed = pytest.importorskip("distributed")
    cluster = distributed.LocalCluster(
        n_workers=1, threads_per_worker=3, processes=False, dashboard_address="127.0.0.1:0", protocol="tcp"
    )

    def leave(done, units, text):
        cluster.close()

    with (
        distributed.Client(cluster, set_as_default=False) as client,
        raises(GmwmError, "scheduler"),
    ):
        fleet(few, tmp_path / "out", within=WITHIN, scheduler=client, progress=leave)
    found = fleet(few, tmp_path / "out", within=WITHIN, workers=0)
    assert (found.kept, found.done) == (1, 5)


# --- what goes wrong in a unit ----------------------------------------------------------------------


def test_errors_of_the_file_system_are_tried_again_and_then_told(few, tmp_path, monkeypatch):
    tried = []

    def flaky(path, options):
        tried.append(path.name)
        if path.name == "1.parquet" and tried.count(path.name) <= 2:
            raise OSError(errno.EIO, "Input/output error")
        if path.name == "2.parquet":
            # As readers say it.
            raise ReadError(f"{path} cannot be opened: Stale file handle") from OSError(errno.ESTALE, "")
        if path.name == "3.parquet":
            raise ReadError(f"{path} does not exist") from FileNotFoundError(errno.ENOENT, "")
        return read_file(path, options)

    monkeypatch.setattr(unit_job, "read_file", flaky)
    found = fleet(few, tmp_path / "out", within=WITHIN, workers=0, retries=2)
    assert found.failed == {
        "2.parquet": f"{few / '2.parquet'} cannot be opened: Stale file handle",
        "3.parquet": f"{few / '3.parquet'} does not exist",
    }
    assert [tried.count(f"{k}.parquet") for k in range(6)] == [1, 3, 3, 1, 1, 1]


def test_an_error_of_ours_is_the_unit_s_own(few, tmp_path, monkeypatch):
    def faulty(path, options):
        if path.name == "4.parquet":
            raise ZeroDivisionError("division by zero")
        return read_file(path, options)

    monkeypatch.setattr(unit_job, "read_file", faulty)
    found = fleet(few, tmp_path / "out", within=WITHIN, workers=0)
    assert found.failed == {"4.parquet": "ZeroDivisionError: division by zero"}
    assert found.done == 5


def test_an_axis_that_fails_is_a_row_and_its_unit_is_calibrated(few, tmp_path, monkeypatch):
    def half(path, options):
        imu = read_file(path, options)
        flat = gmwm.Signal([1.0] * 2000, 100.0, "rad/s", "gyro_y")
        return gmwm.Imu({"gyro_x": imu["gyro_x"], "gyro_y": flat}, str(path), time_base=imu.time_base)

    monkeypatch.setattr(unit_job, "read_file", half)
    found = fleet([few / "0.parquet"], tmp_path / "out", within=WITHIN, workers=0)
    assert (found.done, found.failed) == (1, {})
    rows = found.table.select("axis", "status", "reason").rows()
    assert [row[:2] for row in rows] == [("gyro_x", "calibrated"), ("gyro_y", "failed")]
    assert "constant" in rows[1][2]


def test_what_reading_warns_of_is_kept_with_the_unit(few, tmp_path):
    values = simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=1000, rng=2)["gyro_x"].values
    text = "time,accel_x,accel_y,accel_z\n"
    text += "".join(f"{k / 100:.2f},{v!r},{-v!r},{1 + v!r}\n" for k, v in enumerate(values.tolist()))
    (few / "g.csv").write_text(text)
    with pytest.warns(gmwm.errors.InferredUnitWarning) as warned:
        read(few / "g.csv")
    remarks = {one.message.remark for one in warned}
    found = fleet([few / "g.csv"], tmp_path / "out", within="WN", workers=0)["g.csv"]
    assert remarks <= {*found.recording_remarks}


# --- what is a unit, and what it is called ----------------------------------------------------------


def test_paths_are_called_by_what_they_do_not_share(few, tmp_path):
    made(few / "a" / "0.csv", seed=1)
    found = fleet([few / "a" / "0.csv", few / "0.parquet"], tmp_path / "out", within=WITHIN, workers=0)
    assert set(found.units) == {"a/0.csv", "0.parquet"}
    named = fleet({"left": few / "0.parquet", "lot/right": few / "1.parquet"}, tmp_path / "b", within="WN", workers=0)
    assert named.units == ("left", "lot/right")
    assert Calibration.load(tmp_path / "b" / "units" / "lot" / "right.json").source.endswith("1.parquet")


def test_results_in_the_folder_of_recordings_are_no_recordings(few):
    fleet(few, few / "one", within="WN", workers=0)
    found = fleet(few, few / "two", within="WN", workers=0)
    assert found.units == tuple(f"{k}.parquet" for k in range(6))
    assert found.left_out == ()


def test_a_pattern_says_which_files(few, tmp_path):
    made(few / "lot" / "1.csv", seed=1)
    (few / "lot" / "table.md").write_text("none")

    def units(pattern):
        return list(find_units(few, tmp_path, pattern).paths)

    assert units("*.csv") == ["lot/1.csv"]
    assert units("lot/*") == ["lot/1.csv", "lot/table.md"]
    assert units("[01].*") == ["0.parquet", "1.parquet", "lot/1.csv"]
    with raises(OptionError, argument="pattern", got="*.mat"):
        units("*.mat")


def test_a_folder_that_is_a_recording_is_one_unit(tmp_path):
    (tmp_path / "bags" / "run 1").mkdir(parents=True)
    for name in ("metadata.yaml", "run_0.db3", "run_1.db3"):
        (tmp_path / "bags" / "run 1" / name).write_text("x")
    found = fleet(tmp_path / "bags", tmp_path / "out", workers=0)
    assert list(found.failed) == ["run 1"]


@pytest.mark.parametrize(
    ("names", "got"),
    [
        ({"../above": "x"}, "../above"),
        ({"/root": "x"}, "/root"),
        ({"": "x"}, ""),
        ({"a//b": "x"}, "a//b"),
        (["x", "x"], os.path.abspath("x")),
        ([], []),
        (7, 7),
        ("nowhere", os.path.abspath("nowhere")),
    ],
)
def test_recordings_that_are_refused(names, got, tmp_path):
    with raises(OptionError, argument="recordings", got=got):
        fleet(names, tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_units_with_the_same_path_are_refused(tmp_path):
    with raises(OptionError, "'a' and 'a.json/b'"):
        fleet({"a": "x", "a.json/b": "y"}, tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "argument"),
    [
        ({"within": "WN + XX"}, None),
        ({"confidence": 95}, "confidence"),
        ({"robust": "yes"}, "robust"),
        ({"axes": ()}, "axes"),
        ({"reading": {"rate": -1}}, "rate"),
        ({"reading": {"units": {"gyro": "furlong"}}}, "unit"),
        ({"reading": {"gaps": "glue"}}, "gaps"),
        ({"reading": {"format": "xls"}}, "format"),
        ({"reading": {"start": float("nan")}}, "start"),
    ],
)
def test_options_are_checked_before_the_work(options, argument, few, tmp_path):
    with pytest.raises(GmwmError) as caught:
        fleet(few, tmp_path / "out", **({"workers": 0} | options))
    assert caught.value.argument == argument
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("options", "argument", "got"),
    [
        ({"axes": "gyro_w"}, "axes", "gyro_w"),
        ({"reading": {"speed": 2}}, "reading", "speed"),
        ({"reading": 100.0}, "reading", 100.0),
        ({"retries": -1}, "retries", -1),
        ({"workers": 1.5}, "workers", 1.5),
        ({"workers": 2, "scheduler": "tcp://127.0.0.1:9"}, "workers", 2),
        ({"pattern": "*.csv", "recordings": ["x.csv"]}, "pattern", "*.csv"),
    ],
)
def test_options_of_a_fleet_are_checked_before_the_work(options, argument, got, few, tmp_path):
    given = {"recordings": few, "workers": 0} | options
    with raises(OptionError, argument=argument, got=got):
        fleet(given.pop("recordings"), tmp_path / "out", **given)
    assert not (tmp_path / "out").exists()


def test_a_folder_that_is_none_of_a_fleet_is_refused(few, tmp_path):
    with raises(ReadError, tmp_path, "fleet.json", advises=["gmwm fleet"]):
        Fleet.load(tmp_path)
    output = tmp_path / "out"
    fleet([few / "0.parquet"], output, within="WN", workers=0)
    whole = (output / "fleet.json").read_text()
    for text, facts, advice in (
        (whole[:50], ["JSON"], RUN_AGAIN),
        ("{}", ['"format"'], RUN_AGAIN),
        (whole.replace('"version": 1', '"version": 99'), ["version 99", "version 1"], "Install a newer gmwm"),
        (whole.replace('"version": 1', '"version": 0'), ["version", "got 0"], RUN_AGAIN),
        (whole.replace('"version": 1', '"version": true'), ["version", "got True"], RUN_AGAIN),
        (whole.replace('"left_out"', '"left"'), ["'left_out'"], RUN_AGAIN),
        (whole.replace('"0.parquet"', '"1.parquet"'), [output], RUN_AGAIN),
    ):
        (output / "fleet.json").write_text(text)
        with raises(ReadError, *facts, advises=[advice]):
            Fleet.load(output)
    (output / "fleet.json").write_text(whole)
    (output / "fleet.parquet").unlink()
    with raises(ReadError, output / "fleet.parquet", advises=[RUN_AGAIN]):
        Fleet.load(output)


def test_results_of_another_fleet_are_told(few, tmp_path):
    output = tmp_path / "out"
    fleet(few, output, within=WITHIN, workers=0)
    fewer = {"unit a": next(iter(sorted(few.rglob("*.*"))))}
    with pytest.warns(GmwmWarning) as warned:
        assert len(fleet(fewer, output, within=WITHIN, workers=0)) == 1
    assert {one.message.remark.facts["count"] for one in warned if isinstance(one.message, GmwmWarning)} == {6}


def test_nothing_is_written_where_no_scheduler_answers(few, tmp_path, monkeypatch):
    pytest.importorskip("distributed")
    monkeypatch.setattr("gmwm.measuring.streaming.scheduling.SCHEDULER_WAIT_S", 0.5)
    with raises(OptionError, "tcp://127.0.0.1:9"):
        fleet(few, tmp_path / "out", within=WITHIN, scheduler="tcp://127.0.0.1:9")
    assert not (tmp_path / "out").exists()


def test_large_recordings_are_read_in_chunks(few, tmp_path, monkeypatch):
    files = [few / "0.parquet", few / "1.parquet"]
    whole = fleet(files, tmp_path / "whole", within=WITHIN, workers=0)
    monkeypatch.setattr("gmwm.files.readers.streams.STREAMED_BYTES", 1000)
    monkeypatch.setattr(unit_job, "read_file", None)  # not come to
    found = fleet(files, tmp_path / "chunks", within=WITHIN, workers=0)
    assert found.done == 2
    assert found.table["model"].to_list() == whole.table["model"].to_list()
    np.testing.assert_allclose(found.table["N"].to_numpy(), whole.table["N"].to_numpy(), rtol=1e-6)
