"""gmwm convert: recordings as tables and as .imu records."""

import numpy as np
import pytest

from gmwm.base.units import AXES
from gmwm.files.readers import read
from gmwm.recording.signals import Imu
from gmwm.theory.simulation import simulate


@pytest.fixture(scope="module")
def survey(tmp_path_factory):
    """Counts of an LN200, 60 s at 62.5 Hz."""
    path = tmp_path_factory.mktemp("convert") / "survey.imu"
    noise = simulate("WN(sigma2=1e-6)", rate=62.5, samples=3750, rng=3)
    Imu.from_arrays({axis: noise[axis] for axis in AXES}, 62.5, start=1000.0).write(path, format="imu:LN200")
    return path


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_keep_every_digit_and_the_way_back_every_byte(gmwm, survey, tmp_path, suffix):
    table, back = tmp_path / f"a{suffix}", tmp_path / "back.imu"
    outcome = gmwm("convert", survey, table, "--format", "imu:LN200")
    assert outcome.code == 0
    assert f"Wrote {table}: 3750 samples at 62.5 Hz, 60 s" in outcome.out
    before, after = read(survey, format="imu:LN200"), read(table)
    assert all(after[axis].values.tobytes() == before[axis].values.tobytes() for axis in AXES)
    assert gmwm("convert", table, back, "--to", "IMU:ln200").code == 0
    assert back.read_bytes() == survey.read_bytes()


def test_json_says_what_was_written(gmwm, survey, tmp_path):
    out = tmp_path / "a.parquet"
    content = gmwm("convert", survey, out, "--format", "imu:LN200", "--json").json
    assert (content["command"], content["file"], content["output"]) == ("convert", str(survey), str(out))
    assert (content["rate"], content["samples"], content["segments"]) == (62.5, 3750, [[0, 3750]])
    assert content["axes"] == list(AXES)
    assert content["units"]["accel_z"] == "m/s²"
    scaled = [remark["facts"]["type"] for remark in content["remarks"] if "factor" in remark["facts"]]
    assert scaled == ["LN200", "LN200"]


@pytest.mark.slow
def test_rate_and_units_are_those_of_other_commands(gmwm, unlabelled, tmp_path):
    out = tmp_path / "a.csv"
    assert gmwm("convert", unlabelled, out, "--rate", 50, "--units", "gyro=deg/s").code == 0
    expected = read(unlabelled, rate=50, units={"gyro": "deg/s"})
    assert read(out)["gyro_x"].values.tobytes() == expected["gyro_x"].values.tobytes()


def test_gaps_stay_unless_cut(gmwm, broken, tmp_path):
    out = tmp_path / "a.csv"
    assert gmwm("convert", broken, out, "--json").json["segments"] == [[0, 300], [300, 500]]
    assert read(out).segments == ((0, 300), (300, 500))
    assert gmwm("convert", broken, out, "--gaps", "longest", "--json").json["samples"] == 300


def test_a_temperature_that_is_left_out_is_remarked(gmwm, tmp_path):
    source, out = tmp_path / "a.csv", tmp_path / "a.imu"
    values = np.random.default_rng(0).normal(size=(20, 6))
    rows = "".join(f"{k / 10},{','.join(map(str, row))},{20 + k}\n" for k, row in enumerate(values.tolist()))
    source.write_text(",".join(["time [s]", *(f"{a} [rad/s]" for a in AXES[:3]), *(f"{a} [m/s²]" for a in AXES[3:]),
                                "temperature [°C]"]) + "\n" + rows)  # fmt: skip
    outcome = gmwm("convert", source, out, "--to", "imu:IXSEA", "--json")
    (remark,) = (one for one in outcome.json["remarks"] if one["code"] == "not-in-file")
    assert (remark["subject"], remark["facts"]) == (str(out), {"case": "temperature", "format": ".imu"})


@pytest.mark.slow
def test_errors_take_one_line_and_leave_no_file(gmwm, survey, unlabelled, tmp_path):
    out = tmp_path / "a.imu"
    cases = [
        (["survey.imu", "--format", "imu:LN200", "imu:LN200IG"], (survey, tmp_path / "a.csv")),
        (["--to", "imu:IMAR"], (survey, out, "--format", "imu:LN200")),
        (["--to must be ", "imu:IMAR", "'imu:X'"], (survey, out, "--format", "imu:LN200", "--to", "imu:X")),
        (["--to", ".imu"], (survey, tmp_path / "a.csv", "--format", "imu:LN200", "--to", "imu:IMAR")),
        (["gyro_y", "gyro_z"], (unlabelled, out, "--rate", 50, "--units", "gyro=deg/s", "--to", "imu:IMAR")),
        ([".csv", ".parquet", ".imu", "a.xlsx"], (survey, tmp_path / "a.xlsx", "--format", "imu:IMAR")),
        (["FILE", "OUT", str(survey)], (survey, survey, "--format", "imu:LN200", "--to", "imu:LN200")),
        (["--format must be ", "'im'"], (survey, out, "--format", "im")),
        ([str(tmp_path / "none.csv")], (tmp_path / "none.csv", out)),
    ]
    before = survey.read_bytes()
    for facts, arguments in cases:
        outcome = gmwm("convert", *arguments)
        assert outcome.code == 2, facts
        (line,) = (line for line in outcome.err.splitlines() if not line.startswith("warning: "))
        assert line.startswith("error: ")
        assert all(fact in line for fact in facts), (facts, line)
        assert outcome.out == ""
    assert not list(tmp_path.iterdir())
    assert survey.read_bytes() == before


@pytest.mark.slow
def test_counts_and_increments_of_any_table(gmwm, tmp_path):
    counts, out = tmp_path / "counts.csv", tmp_path / "a.csv"
    k = np.arange(200)
    counts.write_text("t [s],gx,az\n" + "".join(f"{i / 100},{i % 5 - 2},{163.84 + i % 3}\n" for i in k))
    given = ("--units", "gyro=deg/s,accel=g", "--scale", "gyro=1/131,accel_z=1/16384", "--increments", "accel")
    assert gmwm("convert", counts, out, *given).code == 0
    imu = read(out)
    np.testing.assert_allclose(imu["gyro_x"].values, np.radians((k % 5 - 2) / 131), rtol=1e-12)
    np.testing.assert_allclose(imu["accel_z"].values, (163.84 + k % 3) / 163.84 * 9.80665, rtol=1e-12)
    for wrong, got in (("gyro", "gyro"), ("gyro=1/0", "gyro=1/0"), ("mag=2", "mag")):
        outcome = gmwm("convert", counts, tmp_path / "b.csv", "--scale", wrong)
        assert outcome.code == 2
        assert outcome.err.startswith("error: --scale must be ")
        assert outcome.err.endswith(f"; got {got!r}\n")
