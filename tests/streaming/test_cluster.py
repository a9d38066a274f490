"""A recording spread over worker processes is the recording in one pass."""

import os
import signal
import sys
import time

import distributed
import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.base.errors import (
    GmwmError,
    GmwmWarning,
    MissingDependencyError,
    OptionError,
    ReadError,
    TimeBaseWarning,
)
from gmwm.base.remarks import Remark
from gmwm.files.formats import arrays, parquet, text
from gmwm.files.readers import interpretation
from gmwm.measuring.streaming import cluster, scheduling
from gmwm.measuring.streaming.scheduling import connect
from tests.helpers import raises, warns

UNITS = {"gyro": "deg/s"}
SMALL = 20_000


@pytest.fixture(scope="module")
def client():
    """Two worker processes, whose chunks are so small that a file of some hundred thousand rows has many of them."""

    class Smaller(distributed.WorkerPlugin):  # of a worker that replaces one, too; by value, as the test is not there
        def setup(self, worker):
            from gmwm.files.formats import arrays, parquet, text

            arrays.ARRAY_ROWS = parquet.TABLE_ROWS = 20_000
            text.BLOCK_BYTES = 400_000

    with connect(workers=2) as found:
        found.register_plugin(Smaller())
        yield found


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch):
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 10_000)
    for module, name, value in (
        (arrays, "ARRAY_ROWS", SMALL), (parquet, "TABLE_ROWS", SMALL), (text, "BLOCK_BYTES", 20 * SMALL)
    ):  # fmt: skip
        monkeypatch.setattr(module, name, value)


def recording(path, rows=200_000, gaps=(30_000, 60_000, 60_002, 125_000), seed=1):
    """Two axes at 100 Hz; gaps at seams of chunks and elsewhere."""
    rng = np.random.default_rng(seed)
    k = np.arange(rows)
    tick = k + 70_000 * np.searchsorted(np.array(gaps), k, side="right")
    walk = np.cumsum(rng.normal(size=rows)) * 1e-3
    frame = pl.DataFrame({"time": tick * 0.01, "gyro_x": rng.normal(size=rows), "gyro_y": walk + rng.normal(size=rows)})
    if path.suffix == ".csv":
        frame.write_csv(path)
    elif path.suffix == ".parquet":
        frame.write_parquet(path, row_group_size=33_333)
    else:
        np.save(path, frame.to_numpy().copy())
    return path


def opened(path):
    names = ["time", "gyro_x", "gyro_y"] if path.suffix == ".npy" else None
    units = UNITS | ({"time": "s"} if path.suffix == ".npy" else {})
    return gmwm.stream(path, columns=names, units=units)


def same(found, expected, apart=1e-12):
    assert list(found) == list(expected)
    for axis, curve in expected.items():
        for name in ("levels", "counts"):
            assert np.array_equal(getattr(found[axis], name), getattr(curve, name)), name
        for name in ("variance", "lower", "upper"):
            assert np.allclose(getattr(found[axis], name), getattr(curve, name), rtol=apart, atol=0), name
        for name in ("segments", "samples", "rate", "unit", "axis", "strides", "robust", "confidence"):
            assert getattr(found[axis], name) == getattr(curve, name), name
        assert found[axis].slope == (None if curve.slope is None else pytest.approx(curve.slope, rel=1e-9))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".parquet", ".csv", ".npy"])
def test_two_workers_give_what_one_pass_gives(tmp_path, client, suffix):
    source = opened(recording(tmp_path / f"a{suffix}"))
    expected = source.wavelet_variance(exact=12)
    base, told = source.time_base, []
    assert expected["gyro_x"].segments == (30_000, 30_000, 2, 64_998, 75_000)
    assert expected["gyro_x"].strides[-1] > 1
    found = source.wavelet_variance(scheduler=client, parts=6, exact=12, done=told.append)
    same(found, expected)
    assert told == sorted(told)
    assert told[-1] == 200_000
    assert source.time_base.gaps == base.gaps
    same(source.wavelet_variance(scheduler=client.scheduler.address, levels=6, confidence=0.9),
         source.wavelet_variance(levels=6, confidence=0.9))  # fmt: skip


@pytest.mark.slow
def test_robust_ones_too(tmp_path, client):
    path = recording(tmp_path / "a.parquet")
    frame = pl.read_parquet(path)
    frame.with_columns(pl.when(pl.int_range(pl.len()) % 997 == 5).then(50.0).otherwise(pl.col("gyro_x"))
                       .alias("gyro_x")).write_parquet(path)  # fmt: skip
    source, told = opened(path), []
    found = source.wavelet_variance(scheduler=client, parts=5, exact=12, robust=True, done=told.append)
    same(found, source.wavelet_variance(exact=12, robust=True), apart=1e-9)
    assert told[-1] == 400_000
    once = source.wavelet_variance(scheduler=client, parts=3, robust=True, passes=1, exact=14, efficiency=0.9)
    same(once, source.wavelet_variance(robust=True, passes=1, exact=14, efficiency=0.9), apart=1e-9)


@pytest.mark.slow
def test_a_part_is_tried_again_after_trouble_that_is_not_its_own(tmp_path, client, monkeypatch):
    source, log = opened(recording(tmp_path / "a.npy")), tmp_path / "log"
    measure = cluster._measure

    def flaky(part, begin):
        with log.open("a") as file:
            file.write(f"{part.first}\n")
        if log.read_text().split().count(str(part.first)) < 3:
            raise OSError("the network is down")
        return measure(part, begin)

    monkeypatch.setattr(cluster, "_measure", flaky)
    same(source.wavelet_variance(scheduler=client, parts=3), source.wavelet_variance())
    assert len(log.read_text().split()) == 9
    log.unlink()
    monkeypatch.setattr(cluster, "RETRIES", 1)
    with pytest.raises(OSError, match="the network is down"):
        source.wavelet_variance(scheduler=client, parts=3)


@pytest.mark.slow
def test_lost_samples_are_those_of_one_pass(tmp_path, client):
    path = recording(tmp_path / "a.parquet")
    frame = pl.read_parquet(path)
    numbers = frame["gyro_x"].to_numpy().copy()
    numbers[[150_000, 190_000]] = np.nan
    frame.with_columns(gyro_x=numbers).write_parquet(path)
    with warns("samples-lost:axes", count=2):
        expected = opened(path).wavelet_variance()
    with warns("samples-lost:axes", count=2):
        same(opened(path).wavelet_variance(scheduler=client, parts=10), expected)


@pytest.mark.slow
def test_warnings_are_those_of_one_pass(tmp_path, client):
    path = recording(tmp_path / "a.parquet")
    frame = pl.read_parquet(path)
    twice = frame["time"].to_numpy().copy()
    twice[[50_000, 160_000]] = twice[[49_999, 159_999]]
    frame.with_columns(time=twice).write_parquet(path)
    with pytest.warns(TimeBaseWarning) as told:
        opened(path).wavelet_variance(scheduler=client, parts=4)
    assert [one.message.remark for one in told] == [Remark.of("stamps-irregular", str(path), case="repeated", count=2)]
    assert [warning.filename for warning in told] == [__file__]


def test_a_file_that_workers_do_not_find(tmp_path, client, monkeypatch):
    path = recording(tmp_path / "a.npy")
    source, measure = opened(path), cluster._measure
    monkeypatch.setattr(
        cluster, "_measure", lambda part, begin: (path.unlink(missing_ok=True), measure(part, begin))[1]
    )
    with raises(ReadError, "a.npy", code="not-found", advises=["every machine"]):
        source.wavelet_variance(scheduler=client, parts=4)


@pytest.mark.slow
def test_what_is_interrupted_leaves_nothing_behind(tmp_path, client):
    source = opened(recording(tmp_path / "a.parquet"))

    def interrupt(samples):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        source.wavelet_variance(scheduler=client, parts=10, done=interrupt)

    def left(dask_scheduler):
        return [key for key in dask_scheduler.tasks if "_measure" in str(key) or "_unpacked" in str(key)]

    until = time.monotonic() + 300
    while client.run_on_scheduler(left) and time.monotonic() < until:
        time.sleep(0.02)
    assert client.run_on_scheduler(left) == []
    assert client.submit(sum, [1, 2], pure=False).result() == 3


@pytest.mark.slow
def test_only_some_parts_are_asked_for_at_once(tmp_path, client, monkeypatch):
    source, running, most = opened(recording(tmp_path / "a.npy")), set(), []
    ask, answer = cluster._Crew._ask, cluster._Crew._answer

    def asked(crew, k, *rest):
        running.add(k)
        most.append(len(running))
        return ask(crew, k, *rest)

    def answered(crew, k, future):
        running.remove(k)
        return answer(crew, k, future)

    monkeypatch.setattr(cluster._Crew, "_ask", asked)
    monkeypatch.setattr(cluster._Crew, "_answer", answered)
    source.wavelet_variance(scheduler=client, parts=10)
    assert len(most) == 10
    assert max(most) <= 4
    # By default there are four parts for each thread.
    client.wait_for_workers(2, timeout=300)
    most.clear()
    source.wavelet_variance(scheduler=client)
    assert len(most) == 8


def pids(client):
    return set(client.run(os.getpid).values())


@pytest.mark.slow
def test_a_worker_that_is_killed_half_way(tmp_path, client):
    source = opened(recording(tmp_path / "a.parquet"))
    before, killed = pids(client), []

    def kill(samples):
        if not killed:
            killed.append(min(pids(client)))
            os.kill(killed[0], signal.SIGKILL)

    same(source.wavelet_variance(scheduler=client, parts=10, exact=12, done=kill), source.wavelet_variance(exact=12))
    assert killed[0] in before - pids(client)


@pytest.mark.slow
def test_workers_that_die_of_a_part(tmp_path, client, monkeypatch):
    source = opened(recording(tmp_path / "a.npy"))
    monkeypatch.setattr(client.cluster.scheduler, "allowed_failures", 0)
    monkeypatch.setattr(cluster, "_measure", lambda part, begin: os._exit(1))
    with raises(GmwmError, "Part(rows ", advises=["smaller chunk"]):
        source.wavelet_variance(scheduler=client, parts=2)


def test_options_are_checked_at_the_door(tmp_path, client, monkeypatch):
    source = opened(recording(tmp_path / "a.npy", rows=20_000, gaps=()))
    with raises(OptionError, argument="exact"):
        source.wavelet_variance(scheduler="tcp://127.0.0.1:1", exact=2)
    with raises(OptionError, argument="passes", got=3):
        source.wavelet_variance(scheduler=client, passes=3)
    with raises(OptionError, argument="count"):
        source.wavelet_variance(scheduler=client, parts=0)
    for workers in (0, True, "two"):
        with raises(OptionError, argument="workers"), connect(workers=workers):
            pass
    with raises(OptionError, advises=["scheduler=", "workers="]), connect(client, workers=2):
        pass
    for address in ("127.0.0.1:8786", "", 8786):
        with raises(OptionError, "tcp://", argument="scheduler"), connect(address):
            pass
    monkeypatch.setattr(scheduling, "SCHEDULER_WAIT_S", 0.3)
    with raises(OptionError, "tcp://127.0.0.1:1"):
        source.wavelet_variance(scheduler="tcp://127.0.0.1:1")
    with raises(OptionError, "nonsense://x"), connect("nonsense://x"):
        pass


@pytest.mark.slow
def test_without_dask_it_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with raises(MissingDependencyError, advises=['pip install "gmwm[dask]"']), connect():
        pass


@pytest.mark.slow
def test_processes_that_do_not_begin(monkeypatch):
    def broken(**options):
        raise RuntimeError("Nanny failed to start.")

    monkeypatch.setattr(distributed, "LocalCluster", broken)
    with raises(GmwmError, "Nanny failed", advises=["if __name__ == "]), connect(workers=1):
        pass


@pytest.mark.slow
def test_a_scheduler_without_workers_is_told():
    options = {"n_workers": 0, "processes": False, "dashboard_address": ":0", "silence_logs": 50}
    with (
        distributed.LocalCluster(**options) as empty,
        pytest.warns(GmwmWarning) as told,
        connect(empty.scheduler_address),
    ):
        pass
    assert [warning.filename for warning in told] == [__file__]
    assert [warning.message.remark.code for warning in told] == ["no-workers"]


@pytest.mark.slow
def test_a_scheduler_that_sends_to_all_while_a_client_registers(client, monkeypatch):
    """Dask's handshake fails where the answer comes in one message with another one: then it is repeated."""
    failures = [AssertionError(), AssertionError()]
    client.wait_for_workers(2, timeout=300)  # those that an earlier test killed are started again

    class Failing(distributed.Client):
        def __init__(self, *arguments, **options):
            if failures:
                raise failures.pop()
            super().__init__(*arguments, **options)

    monkeypatch.setattr(distributed, "Client", Failing)
    with connect(client.scheduler.address) as other:
        assert other.scheduler_info(n_workers=-1)["workers"]
    assert not failures
    monkeypatch.setattr(scheduling, "SCHEDULER_WAIT_S", 0)
    failures.extend(AssertionError() for _ in range(2))
    with raises(OptionError, "other clients only"), connect(client.scheduler.address):
        pass
