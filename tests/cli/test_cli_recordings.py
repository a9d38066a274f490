"""gmwm calibrate, fit and select with several recordings of one unit."""

import json
from pathlib import Path

import pytest

from gmwm import Calibration
from gmwm.theory.simulation import simulate
from tests.readers.rosbag_files import START, STEP, imu, numbers, store_of, written

DAYS = ("monday", "tuesday", "wednesday")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("days")
    for k, (day, sigma2) in enumerate(zip(DAYS, (1e-6, 1.3e-6, 0.8e-6), strict=True)):
        truth = {"gyro_x": f"WN(sigma2={sigma2}) + RW(gamma2=1e-11)", "accel_x": "WN(sigma2=2e-5)"}
        simulate(truth, rate=50.0, samples=8000, rng=k).write(folder / f"{day}.csv")
    return [str(folder / f"{day}.csv") for day in DAYS]


@pytest.mark.slow
def test_calibrate_says_first_whether_they_differ(gmwm, files, tmp_path):
    found = gmwm("calibrate", *files, "--within", "WN + RW", "--output", tmp_path / "results")
    assert found.code == 0
    parts = found.out.split("\n\n")
    assert parts[0].startswith("N can be used on 2 of 2 axes")
    assert parts[1].startswith("Calibration of 3 recordings: monday, tuesday, wednesday")
    assert "differ in gyro_x (N by" in " ".join(parts[2].split())
    assert "agree in accel_x (N within" in " ".join(parts[3].split())
    document = json.loads((tmp_path / "results" / "calibration.json").read_text(encoding="utf-8"))
    assert [one["file"] for one in document["recordings"].values()] == [f"{day}.csv" for day in DAYS]
    assert document["recording"] is None
    assert (tmp_path / "results" / "report.html").stat().st_size > 100_000


@pytest.mark.slow
def test_fit_and_select(gmwm, files):
    found = gmwm("fit", *files, "--axis", "gyro_x", "--model", "WN", "--json")
    document = json.loads(found.out)
    assert document["files"] == files
    assert document["axes"]["gyro_x"]["replicates"]["recordings"] == list(DAYS)
    text = gmwm("fit", *files, "--axis", "gyro_x", "--model", "WN").out
    assert text.index("The 3 recordings differ") < text.index("N (deg/√h)") < text.index("WN.sigma2")
    ranking = json.loads(gmwm("select", *files[:2], "--axis", "accel_x", "--within", "WN + RW", "--json").out)
    assert ranking["axes"]["accel_x"]["recordings"] == 2
    one = json.loads(gmwm("fit", files[0], "--axis", "gyro_x", "--model", "WN", "--json").out)
    assert one["file"] == files[0]
    assert "replicates" not in one["axes"]["gyro_x"]


def test_an_axis_that_one_recording_lacks_is_not_calibrated(gmwm, files, tmp_path):
    paths = [str(tmp_path / f"{sensor}.csv") for sensor in ("gyro", "accel")]
    for path, axis in zip(paths, ("gyro_x", "accel_x"), strict=True):
        simulate({axis: "WN(sigma2=1e-6)"}, rate=50.0, samples=8000, rng=9).write(path)
    for options in (("--within", "WN + RW"), ("--model", "WN")):
        found = gmwm("calibrate", files[0], paths[0], *options)
        assert found.code == 0
        assert "accel_x  ✗ not calibrated: gyro does not have this axis" in found.out
    gmwm("calibrate", *paths).require_refusal(
        "no axis in common: gyro: gyro_x; accel: accel_x. Calibrate each by itself"
    )


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("calibrate", "{0}", "{1}", "--workers", "2"), "--workers"),
        (("calibrate", "{0}", "{1}", "--all-topics"), "--all-topics"),
        (("fit", "{0}", "{1}", "--model", "WN", "--likelihood"), "--likelihood"),
        (("fit", "{0}", "{1}", "--model", "WN", "--conditions", "table.csv"), "--conditions"),
        (("calibrate", "{0}", "{0}"), "given twice"),
    ],
)
def test_what_is_refused_has_one_line(gmwm, files, arguments, word):
    found = gmwm(*(argument.format(*files) for argument in arguments))
    assert found.code != 0
    (line,) = found.err.strip().splitlines()
    assert line.startswith("error: ")
    assert word in line


@pytest.mark.slow
def test_files_of_one_name_have_the_names_of_their_folders(gmwm, files, tmp_path):
    for day, file in zip(("cold", "warm"), files, strict=False):
        (tmp_path / day).mkdir()
        (tmp_path / day / "static.csv").write_bytes(Path(file).read_bytes())
    found = gmwm("calibrate", tmp_path / "cold/static.csv", tmp_path / "warm/static.csv", "--within", "WN", "--json")
    assert list(json.loads(found.out)["recordings"]) == ["cold", "warm"]


@pytest.fixture
def two_clocks(tmp_path):
    """A bag as RealSense cameras write it: gyroscopes at 200 Hz and accelerometers at 100 Hz, a topic each."""
    store, data = store_of("mcap"), numbers(4000)
    gyro, accel = data.copy(), data.copy()
    gyro[:, 3:] = accel[:, :3] = 0
    topics = {
        f"/camera/{name}/sample": (
            "sensor_msgs/msg/Imu",
            [(START + k * step, imu(store, START + k * step, row)) for k, row in rows],
        )
        for name, rows, step in (("gyro", enumerate(gyro), STEP), ("accel", enumerate(accel[:2000]), 2 * STEP))
    }
    return written(tmp_path, "mcap", topics)


@pytest.mark.slow
@pytest.mark.usefixtures("without_pictures")
def test_gyroscopes_and_accelerometers_with_a_topic_each_are_one_unit(gmwm, two_clocks, tmp_path):
    outcome = gmwm("calibrate", two_clocks, "--within", "WN", "--output", tmp_path / "both", "--json")
    assert outcome.code == 0, outcome.err
    assert list(outcome.json["axes"]) == ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]
    assert list(outcome.json["recordings"]) == ["/camera/gyro/sample", "/camera/accel/sample"]
    both = Calibration.load(tmp_path / "both" / "calibration.json")
    assert both["gyro_x"].wavelet_variance.rate == pytest.approx(200)
    assert both["accel_x"].wavelet_variance.rate == pytest.approx(100)
    assert "at 200 Hz and 2000 samples at 100 Hz" in (tmp_path / "both" / "imu.yaml").read_text(encoding="utf-8")
    for sensor in ("gyro", "accel"):
        options = ("--topic", f"/camera/{sensor}/sample", "--within", "WN", "--output", tmp_path / sensor)
        assert gmwm("calibrate", two_clocks, *options).code == 0
    joined = gmwm("export", tmp_path / "gyro", tmp_path / "accel")
    assert joined.code == 0, joined.err
    assert joined.out == both.export()
    assert "gyro_x is in more than one" in gmwm("export", tmp_path / "gyro", tmp_path / "both").err


@pytest.mark.slow
def test_one_of_two_topics_can_be_chosen_by_its_axes(gmwm, two_clocks):
    outcome = gmwm("calibrate", two_clocks, "--within", "WN", "--axis", "accel", "--json")
    assert list(outcome.json["axes"]) == ["accel_x", "accel_y", "accel_z"]
