"""gmwm fit --likelihood: the same numbers as gmwm.fit_ml, beside those of the wavelet fit."""

import json

import numpy as np
import pytest

import gmwm as library
from gmwm.base.remarks import Dialect, Remark
from gmwm.files.readers import read
from gmwm.fitting.likelihood.intervals import inference, intervals_if_known
from gmwm.measuring.regression.against import Asked
from tests.helpers import only

MODEL = "GM + WN"


@pytest.fixture(scope="module")
def carried(recording):
    """A wavelet fit of an axis, and the fit by maximum likelihood that it leads to."""
    signal = read(recording)["accel_x"]
    start = library.fit(MODEL, signal)
    return start, library.fit_ml(MODEL, signal, start=start)


@pytest.mark.slow
@pytest.mark.parametrize("option", ["--likelihood", "--ml"])
def test_json_is_the_library_s(gmwm, recording, carried, option):
    outcome = gmwm("fit", recording, "-m", MODEL, "--axis", "accel_x", option, "--json")
    assert outcome.code == 0
    found = outcome.json["axes"]["accel_x"]
    start, fit = carried
    assert found["parameters"] == start.parameters
    intervals, reason = intervals_if_known(fit, 0.95)
    expected = {
        **fit.to_dict(),
        **inference(fit, 0.95, intervals),
        "residuals": fit.residuals(fit.record.values).to_dict(),
    }
    assert reason is None
    assert found["likelihood"] == json.loads(json.dumps(expected))
    assert library.likelihood.LikelihoodFit.from_dict(found["likelihood"]).parameters == fit.parameters


@pytest.mark.slow
def test_without_the_option_nothing_changes(gmwm, recording):
    plain = gmwm("fit", recording, "-m", MODEL, "--axis", "accel_x")
    both = gmwm("fit", recording, "-m", MODEL, "--axis", "accel_x", "--ml")
    assert "likelihood" not in plain.out
    assert both.out.startswith(plain.out)
    assert (
        "likelihood" not in gmwm("fit", recording, "-m", MODEL, "--axis", "accel_x", "--json").json["axes"]["accel_x"]
    )


@pytest.mark.slow
def test_one_axis_is_both_summaries(gmwm, recording, carried):
    start, fit = carried
    outcome = gmwm("fit", recording, "-m", MODEL, "--axis", "accel_x", "--ml", "--confidence", 0.9)
    assert outcome.out == f"{start.summary(0.9)}\n\n{fit.summary(0.9)}\n"


@pytest.mark.slow
def test_tables_of_several_axes(gmwm, recording):
    outcome = gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro", "--ml")
    imu = read(recording)
    assert outcome.code == 0
    second = outcome.out.partition(": 20000 samples at 100 Hz")[2].replace("−", "-")
    for axis in ("gyro_x", "gyro_y", "gyro_z"):
        fit = library.fit_ml("WN + RW", imu[axis], start=library.fit("WN + RW", imu[axis]))
        assert f"{fit.loglikelihood:.3f}" in second
        assert f"{fit.aic:.2f}" in second
        assert f"{fit.bic:.2f}" in second
        for name, (low, high) in fit.confidence_intervals().items():
            assert (f"{fit.parameters[name]:.2e}" if low > 0 else f"≤ {high:.2e}") in second
    assert max(map(len, outcome.out.splitlines())) <= 80


@pytest.mark.slow
def test_terms_that_the_likelihood_does_not_support_are_remarked(gmwm, recording):
    arguments = ("fit", recording, "-m", "WN + QN + RW", "--axis", "gyro_x,gyro_y", "--ml")
    outcome = gmwm(*arguments, "--json")
    gone = {axis: one["likelihood"]["not_supported"] for axis, one in outcome.json["axes"].items()}
    assert any(gone.values())
    found = {(one["subject"], one["facts"]["term"]) for one in outcome.json["remarks"] if one["code"] == "term-zero"}
    text = gmwm(*arguments).out
    for axis, terms in gone.items():
        assert {(f"{axis}, by maximum likelihood", term) for term in terms} <= found
        for term in terms:
            assert Remark.of("term-zero", axis, case="fit", term=term).text(Dialect.SHELL).split(":")[0] in text


def test_gaps_are_missing_samples(gmwm, broken):
    found = gmwm("fit", broken, "-m", "WN", "--ml", "--json").json["axes"]["gyro_x"]["likelihood"]
    assert (found["samples"], found["missing"]) == (500, 1000)
    assert found["residuals"]["samples"] == 500


@pytest.mark.slow
def test_fits_are_written_with_it(gmwm, recording, tmp_path):
    assert gmwm("fit", recording, "-m", "WN + RW", "--axis", "gyro_x", "--ml", "--output", tmp_path).code == 0
    content = json.loads((tmp_path / "fits.json").read_text(encoding="utf-8"))
    fit = library.likelihood.LikelihoodFit.from_dict(content["axes"]["gyro_x"]["likelihood"])
    assert fit.axis == "gyro_x"
    assert "by maximum likelihood" in fit.summary()


@pytest.mark.slow
def test_a_summary_without_the_record_says_what_is_missing(recording):
    signal = read(recording)["gyro_x"]
    with pytest.warns(library.errors.FitWarning) as warned:
        fit = library.fit_ml("WN + QN", signal, start="WN(sigma2=4e-7) + QN(q2=1e-9)")
    assert only([one.message.remark for one in warned], "term-zero:fit").facts["term"] == "QN"
    read_again = library.likelihood.LikelihoodFit.from_dict(fit.to_dict())
    assert fit.confidence_intervals()["QN.q2"][0] == 0.0
    assert "at most" in fit.summary()
    words = read_again.summary()
    missing = intervals_if_known(read_again, 0.95)[1]
    assert missing.code == "no-intervals"
    assert "QN.q2" in missing.facts["reason"]
    assert "residuals" not in words
    assert f"{fit.parameters['WN.sigma2']:.3e}" in words


@pytest.fixture(scope="module")
def heated(tmp_path_factory):
    """A recording whose first axis follows the temperature."""
    rng, n = np.random.default_rng(0), 12_000
    heat = 25 + 3 * np.sin(np.arange(n) / 2400)
    x = 1e-3 * rng.normal(size=(n, 2)) + np.cumsum(2e-6 * rng.normal(size=(n, 2)), axis=0)
    x[:, 0] += 2e-4 * heat
    path = tmp_path_factory.mktemp("heated") / "a.csv"
    np.savetxt(
        path, np.column_stack([np.arange(n) / 100, x, heat]), delimiter=",", comments="",
        header="time [s],gyro_x [rad/s],gyro_y [rad/s],temperature [°C]",
    )  # fmt: skip
    return path


@pytest.mark.slow
@pytest.mark.parametrize("against", ["auto", "temperature", "warmup"])
def test_conditions_are_estimated_in_the_likelihood(gmwm, heated, against):
    given = ("--model", "WN + RW", "--axis", "gyro_x", "--likelihood", "--against", against)
    found = gmwm("fit", heated, *given, "--json").json["axes"]["gyro_x"]["likelihood"]
    imu = library.read(heated)
    arrays = {"temperature": imu.temperature} if "temperature" in against or against == "auto" else {}
    terms = Asked.of("temperature" if against == "auto" else against).terms
    expected = library.fit_ml("WN + RW", imu["gyro_x"], against=Asked(terms, arrays))
    assert found["parameters"] == pytest.approx(dict(expected.parameters), rel=1e-4)
    if "temperature" in arrays:
        assert expected.regression["temperature"].value == pytest.approx(2e-4, rel=0.2)
        # The residuals are those of the samples without the effect.
        assert found["residuals"]["ljung_box"]["p_value"] > 1e-3


@pytest.mark.slow
def test_an_axis_that_does_not_follow_the_temperature_is_fitted_as_it_is(gmwm, heated):
    found = gmwm("fit", heated, "--model", "WN + RW", "--likelihood", "--against", "auto", "--json").json["axes"]
    assert found["gyro_x"]["likelihood"]["regression"] is not None
    assert found["gyro_y"]["likelihood"]["regression"] is None
