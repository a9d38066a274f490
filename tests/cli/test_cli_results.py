"""Commands print and write the numbers of the library, in every format."""

import csv
import json

import numpy as np
import pytest

import gmwm as library
from gmwm.base.remarks import Dialect
from gmwm.calibration.summary_text import summary
from gmwm.choosing.datasheets.entry import significant
from gmwm.choosing.selection.structure import structure_of
from gmwm.cli.calibrate import run_calibration
from gmwm.files.readers import read
from gmwm.fitting.estimation.summary import IntervalMethod, inference
from gmwm.theory.simulation import reference_imu
from tests.docs import pages, shown

AXES = ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]


@pytest.mark.slow
def test_info_says_what_the_file_holds(gmwm, recording):
    outcome = gmwm("info", recording)
    assert outcome.code == 0
    assert "20000 samples at 100 Hz" in " ".join(outcome.out.split())
    assert all(axis in outcome.out for axis in AXES)


@pytest.mark.slow
def test_info_json(gmwm, recording):
    content = gmwm("info", recording, "--json").json
    assert (content["command"], content["file"]) == ("info", str(recording))
    assert content["gmwm"] == library.__version__
    assert content["rate"] == pytest.approx(100.0)
    assert content["samples"] == 20_000
    assert list(content["axes"]) == AXES
    assert content["axes"]["gyro_x"]["unit"] == "rad/s"
    assert isinstance(content["static"], bool)
    assert isinstance(content["remarks"], list)


def test_info_help_explains_its_columns(gmwm):
    words = " ".join(gmwm("info", "--help").out.split())
    for column in ("mean;", "sd,", "noise,", "LSB,", "wander,"):
        assert column in words


@pytest.mark.slow
def test_a_last_line_without_an_end_is_remarked(gmwm, recording, tmp_path):
    text = recording.read_text(encoding="utf-8")
    whole, open_end = tmp_path / "whole.csv", tmp_path / "open.csv"
    whole.write_text(text, encoding="utf-8")
    open_end.write_text(text[:-3], encoding="utf-8")
    found, missing = (
        [one["code"] for one in gmwm("info", file, "--json").json["remarks"]] for file in (open_end, whole)
    )
    assert "last-line" in found
    assert "last-line" not in missing
    assert "[last-line]" in gmwm("info", open_end, "--all-remarks").out


@pytest.fixture(scope="module")
def moved(recording, tmp_path_factory):
    """The recording with a motion of ten seconds and a knock of one sample."""

    imu = read(recording)
    values = {axis: np.array(imu[axis].values) for axis in imu}
    values["gyro_x"][8000:9000] += 0.5 * np.sin(np.arange(1000) / 50)
    values["accel_y"][333] += 3
    path = tmp_path_factory.mktemp("moved") / "moved.csv"
    library.Imu.from_arrays(values, imu.rate).write(path)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("command", [("wv",), ("fit", "-m", "WN + RW", "--no-certify")])
def test_motion_and_knocks_are_remarked_by_every_command(gmwm, moved, recording, command):
    outcome = gmwm(command[0], moved, *command[1:], "--axis", "gyro_z", "--json")
    inspected, remarks = disturbances(gmwm("info", moved, "--json")), disturbances(outcome)
    assert remarks == inspected
    assert [one["subject"] for one in remarks if one["code"] == "recording-moved"] == ["gyro_x"]
    (knock,) = (one for one in remarks if one["code"] == "knocks")
    assert knock["facts"]["count"] == 1
    assert "--skip" in knock["text"]
    assert all(f"[{one['code']}]" in outcome.err for one in remarks)
    assert disturbances(gmwm(command[0], recording, *command[1:], "--axis", "gyro_z", "--json")) == []


def disturbances(outcome):
    """The remarks about motion and knocks, as JSON has them."""
    return [one for one in outcome.json["remarks"] if one["code"].startswith(("recording-", "knocks"))]


@pytest.mark.slow
def test_after_a_cut_gaps_are_not_remarked(gmwm, broken):
    assert "--gaps longest" in gmwm("info", broken).out
    assert "gaps" in [one["code"] for one in gmwm("info", broken, "--json").json["remarks"]]
    cut = gmwm("info", broken, "--gaps", "longest")
    assert "0 gaps" in cut.out
    assert "--gaps longest" not in cut.out
    codes = [one["code"] for one in gmwm("info", broken, "--gaps", "longest", "--json").json["remarks"]]
    assert "cut" in codes
    assert "gaps" not in codes


@pytest.mark.slow
def test_wv_json_is_the_library_s(gmwm, recording):
    content = gmwm("wv", recording, "--axis", "gyro_y", "--json").json
    assert list(content["axes"]) == ["gyro_y"]
    assert content["axes"]["gyro_y"] == library.wavelet_variance(read(recording)["gyro_y"]).to_dict()


@pytest.mark.slow
def test_wv_table_and_csv(gmwm, recording, tmp_path):
    target = tmp_path / "wv.csv"
    outcome = gmwm("wv", recording, "--csv", target)
    assert outcome.code == 0
    assert str(target) in outcome.out
    with target.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    expected = library.wavelet_variance(read(recording)["accel_z"])
    mine = [row for row in rows if row["axis"] == "accel_z"]
    assert [float(row["variance"]) for row in mine] == expected.variance.tolist()
    assert [float(row["tau_s"]) for row in mine] == expected.tau.tolist()
    assert [int(row["coefficients"]) for row in mine] == expected.counts.tolist()
    assert [float(row["allan_deviation"]) for row in mine] == pytest.approx(np.sqrt(2 * expected.variance))
    assert [float(row["averaging_time_s"]) for row in mine] == (expected.tau / 2).tolist()
    assert mine[0]["unit"] == "m/s²"
    assert len(rows) == 6 * len(expected)
    for value in expected.variance:
        assert f"{value:.4e}" in outcome.out


@pytest.mark.slow
def test_wv_view_and_units(gmwm, recording):
    outcome = gmwm("wv", recording, "--axis", "gyro_x", "--view", "allan", "--datasheet")
    first = library.wavelet_variance(read(recording)["gyro_x"]).variance[0]
    assert "Allan deviation (deg/h)" in outcome.out
    assert f"{np.sqrt(2 * first) * 180 / np.pi * 3600:#.5g}" in outcome.out
    assert "95 % confidence intervals" in outcome.out


@pytest.mark.slow
@pytest.mark.parametrize("extra", [[], ["--axis", "gyro_x"], ["--overlay", "--view", "allan"]])
def test_wv_plot(gmwm, recording, tmp_path, extra):
    target = tmp_path / "wv.png"
    assert gmwm("wv", recording, "--plot", target, *extra).code == 0
    assert target.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_fit_json_is_the_library_s(gmwm, recording):
    outcome = gmwm("fit", recording, "--model", "GM + WN", "--axis", "accel", "--json")
    content = outcome.json
    assert outcome.code == 0
    assert content["model"] == "GM + WN"
    assert list(content["axes"]) == AXES[3:]
    imu = read(recording)
    for axis, found in content["axes"].items():
        fit = library.fit("GM + WN", imu[axis])
        expected = fit.to_dict() | inference(fit, IntervalMethod())
        assert found == json.loads(json.dumps(expected))
        assert set(found) >= {"parameters", "units", "objective", "lower_bound", "weighting", "wavelet_variance"}
        assert found["lower_bound"] <= found["objective"]


@pytest.mark.slow
def test_fit_tables(gmwm, recording):
    outcome = gmwm("fit", recording, "--model", "WN + RW", "--axis", "gyro")
    assert outcome.code == 0
    fits = [library.fit("WN + RW", read(recording)[axis]) for axis in AXES[:3]]
    for found in fits:
        for name, value in found.parameters.items():
            assert (f"{value:.2e}" if value else f"≤ {found.confidence_intervals()[name][1]:.2e}") in outcome.out
        assert found.goodness_of_fit().pvalue_in_words in outcome.out
        assert f"{found.objective:.5g}" in outcome.out
    assert "accel" not in outcome.out


@pytest.mark.slow
def test_fit_tables_show_what_acts_as_another(gmwm, recording):
    outcome = gmwm("fit", recording, "--model", "GM + RW", "--axis", "gyro_y,gyro_z", "--no-certify")
    rows = [line for line in outcome.out.splitlines() if line.split()[:1] in (["GM.beta"], ["GM.sigma2"])]
    assert [row.split()[1:] for row in rows] == [["as", "WN"] * 2] * 2
    remarks = gmwm("fit", recording, "--model", "GM + RW", "--axis", "gyro_y,gyro_z", "--json").json["remarks"]
    found = [(one["subject"], one["facts"]["process"], one["facts"]["parameter"]) for one in remarks
             if one["code"] == "correlation-time-unknown"]  # fmt: skip
    assert found == [("gyro_y", "WN", "WN.sigma2"), ("gyro_z", "WN", "WN.sigma2")]


@pytest.mark.slow
def test_fit_needs_enough_records_of_a_bootstrap(gmwm, recording):
    for given, least in ((("--bootstrap-draws", 38), 39), (("--bootstrap-draws", 198, "--confidence", 0.99), 199)):
        gmwm("fit", recording, "--model", "WN", *given).require_refusal(
            "error: --bootstrap-draws must be ", f"at least {least}"
        )
    assert (
        gmwm("fit", recording, "-m", "WN", "--axis", "gyro_x", "--bootstrap-draws", 19, "--confidence", 0.9).code == 0
    )


@pytest.mark.slow
def test_fit_one_axis_is_its_summary(gmwm, recording):
    expected = library.fit("WN + RW", read(recording)["gyro_z"]).summary()
    assert gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_z").out == expected + "\n"


@pytest.mark.slow
def test_fit_remarks_name_their_axis(gmwm, unlabelled):
    arguments = ("fit", unlabelled, "-m", "WN + QN", "--rate", 100, "--units", "gyro=rad/s", "--json")
    outcome = gmwm(*arguments)
    terms = [(one["subject"], one["facts"]["term"]) for one in outcome.json["remarks"] if one["code"] == "term-zero"]
    assert terms == [("gyro_x", "QN")]
    assert outcome.err == ""  # the text of the command has the remarks on fits
    (*plain, _) = arguments
    assert "[term-zero]" not in gmwm(*plain).err


@pytest.mark.slow
def test_fit_writes_a_directory(gmwm, recording, tmp_path):
    target = tmp_path / "new" / "results"
    outcome = gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_x,gyro_y", "--output", target, "--no-certify")
    assert outcome.code == 0
    assert sorted(path.name for path in target.iterdir()) == ["fit_gyro_x.png", "fit_gyro_y.png", "fits.json"]
    content = json.loads((target / "fits.json").read_text(encoding="utf-8"))
    assert content["axes"]["gyro_x"]["lower_bound"] is None
    assert [line.split() for line in outcome.out.splitlines() if "optimality gap" in line] == [
        ["optimality", "gap", "none", "none"]
    ]


@pytest.mark.slow
def test_fit_plots_all_axes(gmwm, recording, tmp_path):
    target = tmp_path / "fits.svg"
    assert gmwm("fit", recording, "-m", "WN + RW", "--plot", target, "--json").code == 0
    assert "<svg" in target.read_text(encoding="utf-8")


@pytest.mark.slow
def test_units_of_the_command_line_reach_the_numbers(gmwm, unlabelled):
    def white(unit):
        arguments = ("fit", unlabelled, "-m", "WN", "--rate", 100, "--units", f"gyro={unit}", "--json")
        return gmwm(*arguments).json["axes"]["gyro_x"]["parameters"]["WN.sigma2"]

    assert white("deg/s") == pytest.approx(white("rad/s") * (np.pi / 180) ** 2)


@pytest.mark.slow
def test_columns_by_number(gmwm, recording):
    arguments = ("wv", recording, "--columns", "time=0,gyro_z=1", "--units", "gyro=rad/s", "--json")
    found = gmwm(*arguments).json["axes"]
    assert list(found) == ["gyro_z"]
    expected = library.wavelet_variance(read(recording)["gyro_x"]).variance
    assert found["gyro_z"]["variance"] == expected.tolist()


def test_gaps(gmwm, broken):
    content = gmwm("wv", broken, "--gaps", "longest", "--json").json
    assert content["axes"]["gyro_x"]["samples"] == 300


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_simulate_writes_what_it_says(gmwm, tmp_path, suffix):
    target = tmp_path / f"imu{suffix}"
    arguments = ("--model", "gyro=WN(sigma2=1e-6)", "--model", "accel_z=QN(q2=1e-5)")
    outcome = gmwm("simulate", *arguments, "--duration", 2, "--rate", 50, "--seed", 3, "--output", target, "--json")
    content = outcome.json
    assert (content["samples"], content["rate"], content["seed"]) == (100, 50.0, 3)
    assert content["axes"]["accel_z"]["parameters"] == {"QN.q2": 1e-5}
    imu = read(target)
    assert imu.axes == ("gyro_x", "gyro_y", "gyro_z", "accel_z")
    assert len(imu) == 100
    assert imu.rate == pytest.approx(50.0)
    assert abs(imu["accel_z"].values.mean() - 9.80665) < 0.01


@pytest.mark.slow
def test_simulate_seed_is_printed_and_decides(gmwm, tmp_path):
    def written(name, *extra):
        outcome = gmwm("simulate", "--reference", "--duration", 1, "--output", tmp_path / name, *extra)
        assert outcome.code == 0
        return outcome.out, (tmp_path / name).read_bytes()

    says, first = written("a.csv")
    assert "seed 1" in says
    assert written("b.csv", "--seed", 1)[1] == first
    assert written("c.csv", "--seed", 2)[1] != first


@pytest.fixture(scope="module")
def demo(gmwm, tmp_path_factory):
    """The demo, once in words and once as JSON; calibrated once, as both read one file."""
    target = tmp_path_factory.mktemp("demo") / "out"
    patch = pytest.MonkeyPatch()
    found = []

    def once(*given):
        if not found:
            found.append(run_calibration(*given))
        return found[0]

    patch.setattr("gmwm.cli.demo.run_calibration", once)
    try:
        return target, gmwm("demo", "--output", target), gmwm("demo", "--output", target, "--json")
    finally:
        patch.undo()


@pytest.mark.slow
def test_demo_compares_with_the_truth(demo):
    _, words, machine = demo
    assert (words.code, machine.code) == (0, 0)
    rows = machine.json["comparison"]
    truth = {axis: model.sorted(100.0).parameters for axis, model in reference_imu().items()}
    assert {(r["axis"], r["parameter"]) for r in rows} == {(a, p) for a, values in truth.items() for p in values}
    text = " ".join(words.out.split())
    for row in rows:
        assert row["truth"] == truth[row["axis"]][row["parameter"]]
        if row["estimate"] is None:
            assert f"{significant(row['truth'], 3)} none" in text
            continue
        low, high = row["interval"]
        numbers = (significant(x, 3) for x in (row["truth"], row["estimate"], low, high))
        assert "{} {} {} … {}".format(*numbers) in text
        assert low < row["estimate"] < high
        if row["parameter"] in ("WN.sigma2", "QN.q2"):
            # Four standard errors of 720 000 samples, and more where QN and WN share the first levels.
            assert 0.95 < row["estimate"] / row["truth"] < 1.05
    found = [row for row in rows if row["estimate"] is not None]
    assert len(found) > 0.5 * len(rows)
    inside = [row["interval"][0] <= row["truth"] <= row["interval"][1] for row in found]
    assert np.mean(inside) > 0.8
    assert f"{sum(inside)} of {len(inside)} intervals" in " ".join(words.out.split())


@pytest.mark.slow
def test_demo_says_which_models_are_the_truth(demo):
    _, words, machine = demo
    axes = machine.json["calibration"]["axes"]
    truth = {axis: structure_of(model) for axis, model in reference_imu().items()}
    found = {axis: structure_of(library.Model.parse(one["fit"]["model"])) for axis, one in axes.items()}
    same = [axis for axis in truth if truth[axis] == found[axis]]
    assert f" {len(same)} of 6 axes" in words.out
    assert all(f"{axis}: {reference_imu()[axis].structure} was" in words.out for axis in truth if axis not in same)


@pytest.mark.slow
def test_demo_estimates_come_from_its_file(demo, gmwm):
    target, words, machine = demo
    again = gmwm("calibrate", target / "imu.csv", "--axis", "gyro_z", "--json").json
    assert again["axes"]["gyro_z"]["fit"] == machine.json["calibration"]["axes"]["gyro_z"]["fit"]
    found = library.Calibration.load(target)
    assert summary(found, Dialect.SHELL) in words.out
    assert (target / "summary.txt").read_text(encoding="utf-8") == summary(
        found, Dialect.SHELL, details=True, every=True
    ) + "\n"


@pytest.mark.slow
def test_demo_writes_all_it_names(demo):
    target, words, machine = demo
    written = machine.json["written"]
    assert all((target / name.rsplit("/", 1)[-1]).stat().st_size > 0 for name in written)
    assert all(name.rsplit("/", 1)[-1] in words.out for name in written)
    assert sorted(path.name for path in target.iterdir()) == sorted(name.rsplit("/", 1)[-1] for name in written)
    document = json.loads((target / "calibration.json").read_text(encoding="utf-8"))
    assert document == machine.json["calibration"]


@pytest.mark.slow
def test_readme_shows_what_the_demo_prints(demo):
    _, words, _ = demo
    ((_, _, shows),) = [block for block in pages.fenced(pages.DOCS.parent / "README.md") if block[1] == "text"]
    assert shown.missing(shows, words.out) == ""


@pytest.mark.slow
def test_demo_fits_in_eighty_columns(demo):
    target, words, _ = demo
    assert max(len(line.replace(str(target), "out")) for line in words.out.splitlines()) <= 80
    assert "gmwm calibrate FILE" in words.out
