"""gmwm residuals: the checks of a model by its innovations."""

import json

import numpy as np
import pytest

import gmwm as library
from gmwm.base.text import with_minus
from gmwm.files.readers import read


@pytest.mark.slow
@pytest.mark.parametrize("extra", [[], ["--ml"], ["--robust"], ["--lags", 20]])
def test_json_is_the_library_s(gmwm, recording, extra):
    found = gmwm("residuals", recording, "-m", "WN + RW", "--axis", "gyro_y", "--json", *extra).json["axes"]["gyro_y"]
    signal = read(recording)["gyro_y"]
    fit = library.fit("WN + RW", library.wavelet_variance(signal, robust="--robust" in extra))
    if "--ml" in extra:
        fit = library.fit_ml("WN + RW", signal, start=fit)
    checks = fit.residuals(signal).to_dict(20 if "--lags" in extra else None)
    assert {name: found[name] for name in checks} == json.loads(json.dumps(checks))
    assert found["parameters"] == fit.parameters


@pytest.mark.slow
def test_the_true_model_passes_and_another_does_not(gmwm, recording):
    def whiteness(model):
        found = gmwm("residuals", recording, "-m", model, "--axis", "accel", "--json").json["axes"]
        return [one["ljung_box"]["p_value"] for one in found.values()]

    assert min(whiteness("GM + WN")) > 0.005  # once in 70 seeds for three axes
    assert max(whiteness("WN")) < 1e-6


@pytest.mark.slow
def test_values_that_are_given_are_taken(gmwm, recording):
    model = "WN(sigma2=4e-7) + RW(gamma2=1e-11)"
    found = gmwm("residuals", recording, "-m", model, "--axis", "gyro_x", "--json").json["axes"]["gyro_x"]
    assert found["values"] == "given"
    assert found["parameters"] == {"WN.sigma2": 4e-7, "RW.gamma2": 1e-11}
    signal = read(recording)["gyro_x"]
    expected = library.Model.parse(model).residuals(signal)
    assert expected.estimated == 0
    assert found["ljung_box"] == expected.to_dict()["ljung_box"]


@pytest.mark.slow
def test_the_table(gmwm, recording):
    outcome = gmwm("residuals", recording, "-m", "WN + RW", "--axis", "gyro")
    assert outcome.code == 0
    imu = read(recording)
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        (line,) = [line.split() for line in outcome.out.splitlines() if line.split()[:1] == [axis]]
        checks = library.fit("WN + RW", imu[axis]).residuals(imu[axis]).to_dict()
        assert line[1:5] == [
            "20000", with_minus(f"{checks['mean']:+.4f}"), f"{checks['standard_deviation']:.4f}",
            f"{checks['ljung_box']['statistic']:.1f}",
        ]  # fmt: skip
    assert f"over {checks['ljung_box']['lags']} lags" in outcome.out


@pytest.fixture(scope="module")
def fits(gmwm, recording, tmp_path_factory):
    """The files of fits of two gyroscopes, one of them by maximum likelihood too."""
    folder = tmp_path_factory.mktemp("fits")
    assert gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_x,gyro_y", "--ml", "--output", folder).code == 0
    return folder / "fits.json"


@pytest.mark.slow
def test_fits_of_a_file(gmwm, recording, fits):
    content = json.loads(fits.read_text(encoding="utf-8"))["axes"]
    found = gmwm("residuals", recording, "--from-fits", fits, "--json").json["axes"]
    assert list(found) == ["gyro_x", "gyro_y"]
    assert found["gyro_x"]["parameters"] == content["gyro_x"]["parameters"]
    assert found["gyro_x"]["values"] == f"from {fits}"
    found = gmwm("residuals", recording, "--from-fits", fits, "--ml", "--json").json["axes"]
    assert found["gyro_y"]["parameters"] == content["gyro_y"]["likelihood"]["parameters"]
    for name, value in content["gyro_y"]["likelihood"]["residuals"].items():
        assert found["gyro_y"][name] == value


@pytest.mark.slow
def test_models_of_another_recording_were_not_estimated_here(gmwm, recording, fits, tmp_path):
    other = tmp_path / "other.csv"
    other.write_bytes(recording.read_bytes())
    mine, its = (
        gmwm("residuals", file, "--from-fits", fits, "--axis", "gyro_x", "--json").json["axes"]["gyro_x"]["ljung_box"]
        for file in (recording, other)
    )
    assert mine["statistic"] == its["statistic"]
    assert mine["p_value"] < its["p_value"]  # its degrees of freedom are all the lags


@pytest.mark.slow
def test_a_calibration_has_models_of_its_own(gmwm, recording, tmp_path):
    axes = ("--axis", "gyro_x,accel_x")
    within = ("--within", "GM + WN + RW", "--robust", "no")
    assert gmwm("calibrate", recording, *axes, *within, "--output", tmp_path).code == 0
    outcome = gmwm("residuals", recording, "--from-fits", tmp_path / "calibration.json")
    document = json.loads((tmp_path / "calibration.json").read_text(encoding="utf-8"))
    for axis, one in document["axes"].items():
        structure = library.Model.parse(one["fit"]["model"]).structure
        assert any(line.startswith(f" {axis}") and structure in line for line in outcome.out.splitlines())


@pytest.mark.slow
def test_plot(gmwm, recording, tmp_path):
    target = tmp_path / "residuals.png"
    outcome = gmwm("residuals", recording, "-m", "WN + RW", "--axis", "gyro_x", "--plot", target, "--json")
    assert outcome.json["written"] == [str(target)]
    assert target.read_bytes().startswith(b"\x89PNG")


CASES = {
    "no model": (["{file}"], ["--model", "--from-fits"]),
    "both": (["{file}", "-m", "WN", "--from-fits", "{fits}"], ["--model", "--from-fits"]),
    "no states": (["{file}", "-m", "WN + PL"], ["gyro_x: ", "PL"]),
    "no fits": (["{file}", "--from-fits", "{file}"], ["{file}", "fits.json"]),
    "no such fits": (["{file}", "--from-fits", "{folder}/none.json"], ["{folder}/none.json"]),
    "axis without a fit": (
        ["{file}", "--from-fits", "{fits}", "--axis", "gyro_z"],
        ["--axis must be ", "{fits}", "; got 'gyro_z'"],
    ),
    "robust fits": (["{file}", "--from-fits", "{fits}", "--robust"], ["--robust", "--from-fits"]),
    "efficiency alone": (["{file}", "-m", "WN", "--efficiency", "0.9"], ["--efficiency", "--robust"]),
    "several to draw": (["{file}", "-m", "WN", "--plot", "{folder}/r.png"], ["--plot", "gyro_x, gyro_y", "--axis"]),
    "too many lags": (["{broken}", "-m", "WN", "--lags", "500"], ["lags", "499", "500"]),
    "lags for nothing": (["{broken}", "-m", "GM + WN", "--lags", "2"], ["lags", "3", "2"]),
    "exact model": (["{broken}", "-m", "RW(gamma2=0.0)"], ["RW"]),
    "none in common": (["{broken}", "--from-fits", "{accels}"], ["{accels}", "accel_x", "gyro_x"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_errors_take_a_line(gmwm, recording, broken, fits, folder, tmp_path, case):
    arguments, facts = CASES[case]
    accels = tmp_path / "accels.json"
    content = json.loads(fits.read_text(encoding="utf-8"))
    accels.write_text(json.dumps(content | {"axes": {"accel_x": content["axes"]["gyro_x"]}}), encoding="utf-8")
    places = {"file": recording, "broken": broken, "fits": fits, "folder": folder, "accels": accels}
    outcome = gmwm("residuals", *(text.format(**places) for text in arguments))
    assert (outcome.code, outcome.out) == (2, "")
    (line,) = [line for line in outcome.err.splitlines() if not line.startswith("warning: ")]
    assert line.startswith("error: ")
    assert all(fact.format(**places) in line for fact in facts), line


@pytest.mark.parametrize("command", ["track", "residuals"])
def test_help_fits_eighty_columns_and_gives_examples(gmwm, command):
    outcome = gmwm(command, "--help")
    assert outcome.code == 0
    assert f"gmwm {command} static.csv" in outcome.out.partition("Examples:")[2]
    assert max(map(len, outcome.out.splitlines())) <= 80
    assert f"{command} " in gmwm("--help").out


@pytest.mark.slow
def test_a_knock_is_not_normal(gmwm, recording, tmp_path):

    signal = read(recording)["gyro_x"]
    values = np.array(signal.values)
    values[5000] += 0.05
    library.Imu.from_arrays({"gyro_x": values}, signal.rate).write(tmp_path / "knocked.csv")
    found = gmwm("residuals", tmp_path / "knocked.csv", "-m", "WN(sigma2=4e-7) + RW(gamma2=1e-11)", "--json").json
    assert found["axes"]["gyro_x"]["jarque_bera"]["p_value"] < 1e-12
