"""gmwm track prints, plots and writes the tracks of the library."""

import json

import numpy as np
import polars as pl
import pytest

import gmwm as library
from gmwm.files.readers import read

MODEL = "WN(sigma2=4e-7) + RW(gamma2=1e-11)"


def near(value):
    return pytest.approx(value, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "method"), [("smooth", "smooth"), ("filter", "kalman_filter")])
def test_json_is_the_library_s(gmwm, recording, kind, method):
    content = gmwm("track", recording, "-m", "WN + RW", "--axis", "gyro_z", "--kind", kind, "--json").json
    found = content["axes"]["gyro_z"]
    signal = read(recording)["gyro_z"]
    tracks = getattr(library.fit("WN + RW", signal, certify=False), method)(signal)
    assert (content["command"], content["confidence"]) == ("track", 0.95)
    assert (found["kind"], found["samples"], found["missing"], found["unit"]) == (kind, 20_000, 0, "rad/s")
    assert (found["first_time"], found["last_time"]) == (tracks.times[0], tracks.times[-1])
    assert list(found["tracks"]) == ["WN", "RW", "bias"]
    for label, brief in found["tracks"].items():
        path, error = tracks.mean[label], tracks.error[label]
        known = np.isfinite(error)
        low, high = tracks.band(label)
        assert brief["mean"] == near(path[known].mean())
        assert brief["rms_about_mean"] == near(path[known].std())
        assert brief["rms_error"] == near(np.sqrt(np.mean(error[known] ** 2)))
        assert brief["last"] == path[-1]
        assert brief["last_reach"] == near((high[-1] - low[-1]) / 2)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "source"),
    [([], "fitted to the wavelet variance"), (["--ml"], "fitted by maximum likelihood")],
)
def test_what_is_not_given_is_fitted(gmwm, recording, options, source):
    found = gmwm("track", recording, "-m", "WN + RW", "--axis", "gyro_x", "--json", *options).json["axes"]["gyro_x"]
    signal = read(recording)["gyro_x"]
    fit = library.fit("WN + RW", signal, certify=False)
    assert found["values"] == source
    assert found["parameters"] == (library.fit_ml("WN + RW", signal, start=fit) if options else fit).parameters


@pytest.mark.slow
def test_values_that_are_given_are_taken(gmwm, recording):
    found = gmwm("track", recording, "-m", MODEL, "--axis", "gyro_x", "--json").json["axes"]["gyro_x"]
    assert (found["values"], found["parameters"]) == ("given", library.Model.parse(MODEL).parameters)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_the_file_holds_every_track(gmwm, recording, tmp_path, suffix):
    target = tmp_path / f"tracks{suffix}"
    outcome = gmwm("track", recording, "-m", MODEL, "--axis", "gyro_x,gyro_y", "--output", target)
    assert outcome.code == 0
    assert str(target) in outcome.out
    frame = pl.read_csv(target) if suffix == ".csv" else pl.read_parquet(target)
    imu = read(recording)
    names = [
        f"{axis}{name} [rad/s]"
        for axis in ("gyro_x", "gyro_y")
        for name in ("", " WN", " WN sd", " RW", " RW sd", " bias", " bias sd")
    ]
    assert frame.columns == ["time [s]", *names]
    for axis in ("gyro_x", "gyro_y"):
        tracks = library.Model.parse(MODEL).smooth(imu[axis])
        assert np.array_equal(frame[f"{axis} [rad/s]"], imu[axis].values)
        for label in tracks.labels:
            assert np.array_equal(frame[f"{axis} {label} [rad/s]"], tracks.mean[label])
            assert np.array_equal(frame[f"{axis} {label} sd [rad/s]"], tracks.error[label])
    assert np.array_equal(frame["time [s]"], tracks.times)


@pytest.mark.slow
def test_labels_choose(gmwm, recording, tmp_path):
    table, picture = tmp_path / "bias.csv", tmp_path / "bias.png"
    arguments = ("track", recording, "-m", MODEL, "--axis", "gyro_x", "--label", "bias", "--label", "WN")
    assert gmwm(*arguments, "--output", table, "--plot", picture).code == 0
    head = table.read_text(encoding="utf-8").splitlines()[0]
    assert head == "time [s],gyro_x [rad/s]," + ",".join(
        f"gyro_x {label} [rad/s]" for label in ("bias", "bias sd", "WN", "WN sd")
    )
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_gaps_are_missing_samples(gmwm, broken, tmp_path):
    target = tmp_path / "tracks.csv"
    found = gmwm("track", broken, "-m", "WN(sigma2=1e-4) + RW(gamma2=1e-8)", "--output", target, "--json").json
    assert (found["axes"]["gyro_x"]["samples"], found["axes"]["gyro_x"]["missing"]) == (1500, 1000)
    frame = pl.read_csv(target)
    absent = np.isnan(frame["gyro_x [rad/s]"].to_numpy())
    assert absent.sum() == 1000
    error = frame["gyro_x bias sd [rad/s]"].to_numpy()
    # In the middle of a gap of n samples a walk has the variance n γ²/4 more than between its ends.
    assert error[absent].max() ** 2 > 1000 * 1e-8 / 4 > error[~absent].max() ** 2
    assert np.allclose(np.diff(frame["time [s]"]), 0.01, rtol=1e-6)
    words = gmwm("track", broken, "-m", "WN(sigma2=1e-4) + RW(gamma2=1e-8)").out
    assert all(fact in words for fact in ("1500 samples", "15 s", "1000 samples missing", "rad/s"))


@pytest.mark.slow
@pytest.mark.parametrize("length", ["60", "1min"])
def test_a_prediction_widens(gmwm, recording, tmp_path, length):
    target = tmp_path / "ahead.csv"
    arguments = ("track", recording, "-m", MODEL, "--axis", "gyro_x", "--predict", length)
    found = gmwm(*arguments, "--output", target, "--json").json["axes"]["gyro_x"]
    ahead = library.Model.parse(MODEL).predict(read(recording)["gyro_x"], 6000)
    assert (found["kind"], found["samples"]) == ("predict", 6000)
    assert found["first_time"] == near(200.0)
    bias = found["tracks"]["bias"]
    assert bias["last_reach"] > bias["first_reach"] > 0
    assert bias["last"] == ahead.mean["bias"][-1]
    frame = pl.read_csv(target)
    assert frame.columns[:2] == ["time [s]", "gyro_x WN [rad/s]"]
    assert np.array_equal(frame["gyro_x bias sd [rad/s]"], ahead.error["bias"])
    words = gmwm(*arguments).out
    assert " 60 s " in words
    assert max(map(len, words.splitlines())) <= 80


@pytest.mark.slow
def test_the_table(gmwm, recording):
    outcome = gmwm("track", recording, "-m", "GM + WN", "--axis", "accel", "--datasheet", "--confidence", 0.9)
    assert outcome.code == 0
    assert outcome.out.count("GM + WN, values fitted to the wavelet variance") == 3
    assert outcome.out.count("20000 samples, 200 s, in mg") == 3
    assert "± 90 %" in outcome.out
    assert max(map(len, outcome.out.splitlines())) <= 80
    levels = [
        float(line.split()[1].replace("−", "-")) for line in outcome.out.splitlines() if line.split()[:1] == ["bias"]
    ]
    assert levels == pytest.approx([0.0, 0.0, 1000.0], abs=1.0)


@pytest.mark.slow
def test_fits_of_a_file(gmwm, recording, tmp_path):
    assert gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_x,gyro_y", "--ml", "--output", tmp_path).code == 0
    fits = tmp_path / "fits.json"
    content = json.loads(fits.read_text(encoding="utf-8"))["axes"]
    found = gmwm("track", recording, "--from-fits", fits, "--json").json["axes"]
    assert {axis: one["parameters"] for axis, one in found.items()} == {a: c["parameters"] for a, c in content.items()}
    found = gmwm("track", recording, "--from-fits", fits, "--ml", "--axis", "gyro_y", "--json").json["axes"]
    assert found["gyro_y"]["parameters"] == content["gyro_y"]["likelihood"]["parameters"]


@pytest.mark.slow
def test_a_fast_term_of_the_bias_is_remarked(gmwm, recording):
    # Correlation times of 2, 9.8 and 10.2 samples: the limit is 10.
    for beta, samples in ((50.0, 2.0), (10.2, 9.8), (9.8, None)):
        model = f"GM(beta={beta}, sigma2=1e-7) + RW(gamma2=1e-11)"
        outcome = gmwm("track", recording, "-m", model, "--axis", "gyro_x", "--json")
        found = [one for one in outcome.json["remarks"] if one["code"] == "bias-has-noise"]
        assert [(one["subject"], one["facts"]["term"]) for one in found] == [("gyro_x", "GM")] * (samples is not None)
        assert [one["facts"]["samples"] for one in found] == pytest.approx([samples] * len(found), rel=0.01)
        assert ("[bias-has-noise]" in outcome.err) == (samples is not None)


CASES = {
    "no model": (["{file}"], ["--model", "--from-fits"]),
    "no states": (["{file}", "-m", "PL(alpha=2.5, nu2=1e-9)"], ["PL", "from 0 to 2", "2.5"]),
    "a filter ahead": (
        ["{file}", "-m", MODEL, "--kind", "filter", "--predict", "1min"],
        ["--predict", "--kind filter"],
    ),
    "no length": (["{file}", "-m", MODEL, "--predict", "soon"], ["--predict must be ", "; got 'soon'"]),
    "less than a sample": (
        ["{file}", "-m", MODEL, "--predict", "0.001"],
        ["--predict must be ", "0.01 s", "; got 0.001"],
    ),
    "unknown label": (
        ["{file}", "-m", MODEL, "--label", "GM"],
        ["--label must be ", "WN, RW, bias", "gyro_x", "; got 'GM'"],
    ),
    "unknown suffix": (["{file}", "-m", MODEL, "-o", "{folder}/x.txt"], ["x.txt", ".csv", ".parquet"]),
    "no such folder": (["{file}", "-m", MODEL, "-o", "{folder}/none/x.csv"], ["none/x.csv"]),
    "the recording itself": (["{file}", "-m", MODEL, "-o", "{file}"], ["--output must be ", "FILE", "; got '{file}'"]),
    "several to draw": (["{file}", "-m", MODEL, "--plot", "{folder}/x.png"], ["--plot", "--axis"]),
    "unknown picture": (["{file}", "-m", MODEL, "--axis", "gyro_x", "--plot", "{folder}/x.foo"], ["x.foo"]),
    "confidence": (
        ["{file}", "-m", MODEL, "--confidence", "95"],
        ["--confidence must be ", "; got 95"],
    ),
    "another rate": (["{broken}", "--from-fits", "{fits}", "--rate", "50"], ["50"]),
    "no likelihood there": (["{file}", "--from-fits", "{fits}", "--ml"], ["{fits}", "`gmwm fit --likelihood`"]),
}


@pytest.fixture(scope="module")
def fits(gmwm, recording, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fits")
    assert gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_x", "--output", folder, "--no-certify").code == 0
    return folder / "fits.json"


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_errors_take_a_line_and_leave_no_file(gmwm, recording, broken, fits, folder, case):
    arguments, facts = CASES[case]
    before = sorted(folder.iterdir())
    places = {"file": recording, "broken": broken, "fits": fits, "folder": folder}
    outcome = gmwm("track", *(text.format(**places) for text in arguments))
    assert (outcome.code, outcome.out) == (2, "")
    (line,) = [line for line in outcome.err.splitlines() if not line.startswith("warning: ")]
    assert line.startswith("error: ")
    assert all(fact.format(**places) in line for fact in facts), line
    assert sorted(folder.iterdir()) == before


@pytest.mark.slow
def test_an_interrupt_ends_with_130_and_leaves_no_file(gmwm, recording, tmp_path, monkeypatch):
    def press(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("polars.DataFrame.write_csv", press)
    # If a thread of the pool is still running, it would end the process of the tests.
    monkeypatch.setattr("gmwm.cli.main._leave_threads_behind", lambda *_: None)
    outcome = gmwm("track", recording, "-m", MODEL, "--axis", "gyro_x", "--output", tmp_path / "x.csv")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "interrupted\n")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_fits_hold_for_another_recording_of_the_unit(gmwm, recording, fits, tmp_path):

    signal = read(recording)["gyro_x"]
    other = tmp_path / "other.csv"
    library.Imu.from_arrays({"gyro_x": np.array(signal.values)}, signal.rate * (1 + 3e-5)).write(other)
    found = gmwm("track", other, "--from-fits", fits, "--json").json["axes"]["gyro_x"]
    assert found["parameters"] == json.loads(fits.read_text(encoding="utf-8"))["axes"]["gyro_x"]["parameters"]
    gmwm("track", other, "--from-fits", fits, "--columns", "time=,gyro_x=1", "--rate", 200).require_refusal(
        "must be 100", "got 200"
    )
