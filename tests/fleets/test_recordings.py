"""The units of a fleet are the recordings of its files: with lost samples, and several in one file."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

import gmwm
from gmwm import fleet
from gmwm.cli.main import app
from gmwm.files.readers.topics import sensor_topics
from tests.helpers import code_of
from tests.readers.test_dataflash import ACC, GYR, IMU, VALUES, imu, log, message

pytestmark = pytest.mark.slow

ROWS = 2000
WITHIN = "WN + RW"


@pytest.fixture
def logs(tmp_path):
    """Two logs of two IMUs each, with a gyroscope that repeats one, and a recording in text."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for number in range(2):
        parts = [imu(k) + imu(k, 1, shift=0.5 + number) for k in range(ROWS)]
        parts += [
            message(GYR, 65_000_000 + 2500 * k, 0, 65_000_000 + 2500 * k, *VALUES[k, :3].tolist()) for k in range(9)
        ]
        parts += [
            message(ACC, 65_000_000 + 2500 * k, 0, 65_000_000 + 2500 * k, *VALUES[k, 3:].tolist()) for k in range(9)
        ]
        (folder / f"{number}.bin").write_bytes(log(parts, (IMU, ACC, GYR)))
    gmwm.simulate({"gyro_x": "WN(sigma2=1e-4)"}, rate=400.0, samples=ROWS, rng=1).write(folder / "alone.csv")
    return folder


def test_each_imu_of_a_file_is_a_unit(logs, tmp_path):
    assert sensor_topics(logs / "0.bin") == ("IMU_0", "IMU_1")
    found = fleet(logs, tmp_path / "out", within=WITHIN, axes="gyro", workers=0)
    assert found.units == ("0.bin/IMU_0", "0.bin/IMU_1", "1.bin/IMU_0", "1.bin/IMU_1", "alone.csv")
    assert found.failed == {}
    single = gmwm.calibrate(gmwm.read(logs / "1.bin", topic="IMU_1"), within=WITHIN, axes="gyro")
    assert found["1.bin/IMU_1"]["gyro_x"].parameters == single["gyro_x"].parameters
    assert json.loads((tmp_path / "out" / "fleet.json").read_text())["topics"]["1.bin/IMU_1"] == "IMU_1"
    # A second run keeps them all, and a topic that is chosen is the only one.
    assert fleet(logs, tmp_path / "out", within=WITHIN, axes="gyro", workers=0).kept == 5
    one = fleet({"a": logs / "0.bin"}, tmp_path / "one", within=WITHIN, reading={"topic": "IMU_1"}, workers=0)
    assert one.units == ("a",)


def test_the_fleet_of_the_shell_has_them_too(logs, tmp_path):
    given = ["fleet", logs, "--within", WITHIN, "--axis", "gyro_x", "--workers", "0", "--output", tmp_path / "out"]
    done = CliRunner().invoke(app, [*map(str, given), "--json"])
    assert done.exit_code == 0
    assert "1.bin/IMU_0" in json.loads(done.stdout)["units"]


def test_units_with_lost_samples_have_the_calibrations_of_calibrate(tmp_path):
    """Single samples, bursts, and gaps that stay; from memory and in chunks, as `calibrate` measures each alone."""
    folder = tmp_path / "lossy"
    folder.mkdir()
    for unit in range(2):
        rng = np.random.default_rng(unit)
        times = np.arange(6_000) / 100.0
        kept = rng.random(times.size) > (0.001, 0.05)[unit]
        kept[2500:2520] = False
        kept[4000 : 4000 + 300 * unit] = False
        x = rng.normal(size=(times.size, 2)) + np.cumsum(0.01 * rng.normal(size=(times.size, 2)), axis=0)
        np.savetxt(
            folder / f"{unit}.csv", np.column_stack([times, x])[kept], delimiter=",", fmt="%.9g", comments="",
            header="time [s],gyro_x [rad/s],gyro_y [rad/s]",
        )  # fmt: skip
    found = fleet(folder, tmp_path / "out", within=WITHIN, workers=0)
    assert found.failed == {}
    for unit in found.units:
        single = gmwm.calibrate(gmwm.read(folder / unit), within=WITHIN)
        chunked = gmwm.calibrate(gmwm.stream(folder / unit, chunk=777), within=WITHIN)
        for axis in ("gyro_x", "gyro_y"):
            curve = found[unit][axis].wavelet_variance
            assert curve.filled > 0
            for other in (single, chunked):
                assert found[unit][axis].to_dict() == other[axis].to_dict()
        codes = {code_of(remark) for remark in found[unit].recording_remarks}
        assert "gaps-filled:filled" in codes
        assert ("gaps" in codes) == (unit != "0.csv")
    assert found.table.height == 4
