"""A stream of a file is regressed on its temperature as the file in memory is."""

import warnings

import numpy as np
import polars as pl
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.files.formats import parquet
from gmwm.files.readers import interpretation
from gmwm.measuring.inspection import inspect
from gmwm.measuring.regression import blocks
from gmwm.measuring.regression.against import Asked
from gmwm.measuring.regression.conditions import Conditions
from gmwm.recording import batches
from tests.helpers import raises

ROWS = 30_000


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    """Blocks so small that a file of some ten thousand rows has many of them."""
    monkeypatch.setattr(interpretation, "HEAD_ROWS", 5000)
    monkeypatch.setattr(parquet, "TABLE_ROWS", 7001)
    for module in (batches, blocks):
        monkeypatch.setattr(module, "BATCH_SAMPLES", 1 << 13)


@pytest.fixture
def path(request, tmp_path):
    rng, t = np.random.default_rng(3), np.arange(ROWS) / 100
    temperature = 25 + 5 * (1 - np.exp(-t / 100)) + np.sin(t / 35)
    columns = {
        "time [s]": t + 100.0 * (t > 125) + 0.02 * (t > 200),
        "gyro_x [rad/s]": rng.normal(scale=1e-3, size=ROWS) + 2e-4 * temperature,
        "gyro_y [rad/s]": rng.normal(scale=1e-3, size=ROWS),
        "temperature": np.where(np.arange(ROWS) % 25 == 0, np.round(temperature, 3), np.nan),
    }
    columns["gyro_x [rad/s]"][[777, 15_001]] = 0.5  # wrong samples are clipped
    if request.param == "even":
        columns["time [s]"] = t
    if request.param == "lost":
        columns["gyro_y [rad/s]"][rng.random(ROWS) < 0.03] = np.nan
    if request.param == "unstamped":
        del columns["time [s]"]
    pl.DataFrame(columns).write_parquet(tmp_path / "a.parquet")
    return tmp_path / "a.parquet"


def opened(path):
    rate = None if "time [s]" in pl.scan_parquet(path).collect_schema() else 100.0
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return gmwm.read(path, rate), gmwm.stream(path, rate)


AGAINST = ["time:2", "temperature + warmup"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("path", "against"),
    [("gaps", "temperature:2,lag"), ("lost", "temperature:2,lag"), *(("even", against) for against in AGAINST)],
    indirect=["path"],
)
def test_regressions_are_those_in_memory(path, against):
    imu, stream = opened(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, expected = (Conditions.of_recording(one, Asked.of(against)) for one in (stream, imu))
    assert list(found.found) == list(expected.found) == ["gyro_x", "gyro_y"]
    for axis, one in expected.found.items():
        assert found.found[axis].estimates == one.estimates
        assert found.found[axis].pvalue == one.pvalue
        assert found.found[axis].applied == one.applied
    assert found.applied_regression("gyro_x") is not None
    effects = [one.effect("gyro_x", [0, 9999, len(imu) - 1]) for one in (found, expected)]
    assert np.array_equal(*effects)


@pytest.mark.slow
@pytest.mark.parametrize("path", ["lost", "unstamped"], indirect=True)  # The first has the gaps, too.
def test_a_calibration_and_an_inspection_are_those_in_memory(path):
    imu, stream = opened(path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found, expected = (
            [gmwm.calibrate(one, within="WN + RW").to_dict(), inspect(one).to_dict()] for one in (stream, imu)
        )
    assert expected[0]["axes"]["gyro_x"]["left_in"] is not None
    assert expected[1]["temperature"] is not None
    assert found == expected


@pytest.mark.parametrize("path", ["even"], indirect=True)
def test_exact_covariates_need_the_recording_in_memory(path):
    _, stream = opened(path)
    with raises(OptionError, argument="against"):
        inspect(stream, against="temperature:exact")
