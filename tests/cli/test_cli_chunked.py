"""Commands print the same for recordings in chunks and in memory, also with worker processes."""

import pytest

import gmwm as library
from gmwm.files.readers import api, streams

WITHIN = "GM + WN + RW"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    models = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "accel_z": "WN(sigma2=2e-5)"}
    path = tmp_path_factory.mktemp("chunks") / "static.csv"
    library.simulate(models, rate=100.0, samples=20_000, rng=1).write(path)
    return path


def same(gmwm, *arguments):
    """The output of a command, which is the same in memory and in chunks."""
    whole, parts = (gmwm(*arguments, "--chunked", how) for how in ("no", "yes"))
    assert whole.code == parts.code == 0, parts.err
    assert whole.out == parts.out
    assert whole.err == parts.err
    return parts.out


@pytest.mark.slow
def test_info(gmwm, file):
    assert "19000 samples" in gmwm("info", file, "--start", "10s", "--chunked", "yes").out
    same(gmwm, "info", file)


@pytest.mark.slow
@pytest.mark.parametrize("robust", [(), ("--robust",)])
def test_wv(gmwm, file, robust):
    assert "accel" not in same(gmwm, "wv", file, "--axis", "gyro", *robust)


@pytest.mark.slow
def test_fit_and_select(gmwm, file):
    same(gmwm, "fit", file, "--model", "WN + RW", "--axis", "gyro_x")
    same(gmwm, "select", file, "--within", WITHIN, "--robust")


@pytest.mark.slow
def test_calibrate(gmwm, file):
    assert "WN+RW" in same(gmwm, "calibrate", file, "--within", WITHIN)


@pytest.mark.slow
def test_worker_processes(gmwm, file):
    arguments = ("calibrate", file, "--within", "WN + RW", "--axis", "accel")
    assert gmwm(*arguments, "--workers", "1").out == gmwm(*arguments).out


@pytest.mark.slow
def test_large_files_are_read_in_chunks(gmwm, file, monkeypatch):
    monkeypatch.setattr(streams, "STREAMED_BYTES", 1000)
    read = []
    stream = api.stream_file
    monkeypatch.setattr(api, "stream_file", lambda *a, **k: read.append(a) or stream(*a, **k))
    assert gmwm("wv", file).code == 0
    assert len(read) == 1
    for memory in (("--chunked", "no"), ("--filter", "la8"), ("--gaps", "longest")):
        assert gmwm("wv", file, *memory).code == 0
        assert len(read) == 1


@pytest.mark.parametrize(
    ("arguments", "facts"),
    [
        (("wv", "--filter", "la8", "--chunked", "yes"), ["--filter la8", "--chunked yes"]),
        (("wv", "--transform", "dwt", "--workers", "2"), ["--transform dwt", "--workers"]),
        (("calibrate", "--gaps", "longest", "--chunked", "yes"), ["--gaps longest", "--chunked yes"]),
        (("calibrate", "--chunked", "no", "--workers", "2"), ["--workers", "--chunked no"]),
        (("fit", "--model", "WN", "--likelihood", "--chunked", "yes"), ["--likelihood", "--chunked yes"]),
        (("info", "--plot", "a.png", "--chunked", "yes"), ["--plot", "--chunked yes"]),
        (("calibrate", "--scheduler", "10.0.0.5"), ["--scheduler ", "tcp://", "10.0.0.5"]),
    ],
)
def test_options_that_contradict_each_other(gmwm, file, arguments, facts):
    gmwm(arguments[0], file, *arguments[1:]).require_refusal(*facts)
