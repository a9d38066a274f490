"""Results are mappings by name: of a name that they lack they say what there is, and why."""

import numpy as np
import pytest

import gmwm

RATE = 100.0


def said(mapping, name):
    """The words of the KeyError; None where there is none."""
    try:
        mapping[name]
    except KeyError as error:
        return error.args[0]


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_a_parameter_at_zero_has_a_limit_and_no_error():
    x = gmwm.WN(sigma2=1.0).simulate(2000, RATE, rng=2)
    for fit in (gmwm.fit("WN + RW", x, RATE), gmwm.fit_ml("WN + RW", x, RATE)):
        assert fit.diagnostics.not_supported == ("RW",)
        words = "RW.gamma2 has no standard error: it is zero, the end of its domain"
        assert said(fit.standard_errors, "RW.gamma2") == f"{words}; its upper limit is in confidence_intervals()"
        assert 0 < fit.confidence_intervals()["RW.gamma2"][1] < 1
        assert "RW.gamma2" not in fit.standard_errors
        assert fit.standard_errors.get("RW.gamma2") is None


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_a_term_at_zero_with_a_free_shape_has_no_limit():
    fit = gmwm.fit("WN + 2*GM", gmwm.WN(sigma2=1.0).simulate(2000, RATE, rng=2), RATE)
    assert "GM[1]" in fit.diagnostics.not_supported
    assert said(fit.standard_errors, "GM[1].beta").endswith("is estimated as zero, so the parameter has no meaning")
    assert said(fit.standard_errors, "GM[1].sigma2").endswith("the data give it no limit while the shape is free")
    assert fit.confidence_intervals()["GM[1].sigma2"] == (0.0, np.inf)


def test_a_held_parameter_says_so():
    fit = gmwm.fit("GM(beta=fixed(2.0)) + WN", x := noise(), RATE)
    likely = gmwm.fit_ml("GM(beta=fixed(2.0)) + WN", x, RATE)
    for found in (fit, likely):
        assert said(found.standard_errors, "GM.beta") == "GM.beta has no standard error: it is fixed at its value"


@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_a_term_that_acts_as_another_says_so():
    x = (gmwm.WN(sigma2=1.0) + gmwm.RW(gamma2=1e-3)).simulate(20_000, RATE, rng=1)
    fit = gmwm.fit("GM + WN", x, RATE)
    assert fit.diagnostics.acts_as == {"GM": "RW"}
    for name in ("GM.beta", "GM.sigma2"):
        assert said(fit.standard_errors, name).startswith(
            f"{name} has no standard error: GM acts as RW, so the data do not determine"
        )


@pytest.mark.slow
def test_every_result_lists_its_names():
    fit, likely = gmwm.fit("GM + WN", x := noise(), RATE), gmwm.fit_ml("GM + WN", x, RATE)
    three, tracks = "GM.beta, GM.sigma2, WN.sigma2", likely.smooth(x)
    for found in (fit, likely):
        assert said(found.parameters, "foo") == f"there is no parameter 'foo', only {three}"
        assert said(found.standard_errors, "foo") == f"there is no standard error of 'foo', only {three}"
    assert said(fit.decomposition, "RW") == "there is no term 'RW', only GM, WN"
    for mapping in (tracks.mean, tracks.error):
        assert said(mapping, "RW") == "there is no track 'RW', only GM, WN, level, bias"
    plan = gmwm.plan(fit.model, duration=100.0, rate=RATE)
    for mapping in (plan.errors, plan.at(50.0), plan.needed()):
        assert said(mapping, "foo") == f"there is no parameter 'foo', only {three}"


def test_they_are_dicts_in_all_else():
    fit = gmwm.fit("GM + WN", noise(), RATE)
    assert isinstance(fit.parameters, dict)
    assert fit.parameters == dict(fit.parameters)
    assert repr(fit.parameters) == repr(dict(fit.parameters))
    assert np.isnan(fit.parameters.get("foo", np.nan))


def noise():
    """A Gauss-Markov process in white noise, long enough for both to be seen."""
    return gmwm.Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)").simulate(20_000, RATE, rng=2)


def test_a_mapping_of_axis_to_curve_is_fitted_axis_by_axis():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=1.0)", "gyro_y": "WN(sigma2=2.0)"}, rate=10.0, samples=5000, rng=1)
    curves = gmwm.wavelet_variance(imu)
    for data in (curves, dict(curves)):
        fits = gmwm.fit("WN", data)
        assert {axis: one.parameters for axis, one in fits.items()} == {
            axis: gmwm.fit("WN", curve).parameters for axis, curve in curves.items()
        }
    assert [*gmwm.select("WN + RW", curves)] == ["gyro_x", "gyro_y"]
