"""Fits by maximum likelihood: at the top of the likelihood from wherever they start; what is missing is said."""

import json
import warnings

import numpy as np
import pytest
from scipy.optimize import minimize

from gmwm import Imu, Model, fit, fit_ml
from gmwm.base.errors import DataError, FitWarning, MissingTheoryError, ModelError, OptionError, ReadError
from gmwm.fitting.likelihood import LikelihoodFit
from gmwm.fitting.likelihood.problem import LikelihoodProblem, as_record
from gmwm.recording.signals import Signal
from tests.helpers import each, only, raises
from validation.likelihood import fisher_errors, most_likely

RATE = 100.0
TRUTHS = (
    "WN(sigma2=2.0)",
    "GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)",
    "GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
    "AR1(phi=-0.7, sigma2=1.0) + WN(sigma2=0.5)",
    "AR(2, phi1=1.4, phi2=-0.6, sigma2=1.0) + WN(sigma2=3.0)",
    "MA(2, theta1=0.6, theta2=0.3, sigma2=1.0)",
    "ARMA(2, 1, phi1=0.9, phi2=-0.3, theta1=0.5, sigma2=1.0)",
    "GM(beta=1.0, sigma2=2.0) + GM(beta=40.0, sigma2=3.0) + WN(sigma2=1.0) + QN(q2=2.0)",
    "QN(q2=1.0) + WN(sigma2=0.5) + RW(gamma2=1e-3)",
    "SIN(frequency=7.0, power=3.0) + WN(sigma2=1.0)",
    "DR(omega=0.001) + WN(sigma2=1.0) + RW(gamma2=1e-3)",
)


def drawn(text, samples=8000, seed=1):
    model = Model.parse(text)
    return model, 9.81 + model.simulate(samples, RATE, rng=seed)


def top(found, x):
    """The problem at a fit, and its evaluation there by all coordinates that are not at an end."""
    problem = LikelihoodProblem(found.model, as_record(x, RATE), found.mean)
    z = problem.start()
    return problem, z, problem.evaluate(z, list(range(z.size)))


@pytest.mark.slow
@each("gaps", [False, True])
@each("text", TRUTHS)
def test_a_fit_is_at_the_top_of_its_likelihood(text, gaps):
    model, x = drawn(text)
    if gaps:
        x[[*range(1000, 1300), *range(2000, 8000, 301)]] = np.nan
    found = fit_ml(model.structure, x, RATE, start=model)
    assert found.diagnostics.converged
    assert not found.diagnostics.not_supported
    assert found.loglikelihood == pytest.approx(found.model.loglikelihood(x, RATE), rel=1e-12)
    assert found.loglikelihood >= model.loglikelihood(x, RATE)
    assert (found.samples, found.missing) == (np.count_nonzero(np.isfinite(x)), np.count_nonzero(np.isnan(x)))
    problem, z, here = top(found, x)
    # What a step along the slope could still gain.
    assert here.gradient @ np.linalg.solve(here.information, here.gradient) < 1e-5
    for k in range(z.size):
        for side in (-1, 1):
            near = z.copy()
            near[k] += side * 0.1 / np.sqrt(here.information[k, k])
            assert problem.value(problem.at_point(near))[0] < found.loglikelihood
    # Estimates are where they should be, within five standard errors.
    for name, value in found.parameters.items():
        assert abs(value - model.sorted(RATE).parameters[name]) < 5 * found.standard_errors[name], name


@pytest.mark.slow
@pytest.mark.parametrize("text", [t for t in TRUTHS if "SIN" not in t])
def test_the_same_top_is_reached_from_the_wavelets_and_from_afar(text):
    model, x = drawn(text, seed=2)
    found = fit_ml(model.structure, x, RATE)
    elsewhere = model.with_values({
        f"{t}.{p.scale_parameter().name}": 3.0 * p.value(p.scale_parameter().name)
        for t, p in zip(model.terms, model.processes, strict=True)
    })  # fmt: skip
    for start in (model, elsewhere, found):
        other = fit_ml(model.structure, x, RATE, start=start)
        assert other.loglikelihood == pytest.approx(found.loglikelihood, abs=1e-6)
        for name, value in found.parameters.items():
            assert abs(other.parameters[name] - value) < 2e-3 * found.standard_errors[name], name
        assert other.standard_errors == pytest.approx(found.standard_errors, rel=1e-2)


def test_it_is_the_top_that_another_hand_finds():
    model = Model.parse("GM(beta=10.0, sigma2=2e-6) + WN(sigma2=4e-6)")
    x = model.simulate(4000, RATE, rng=2)
    found = fit_ml("GM + WN", x, RATE, mean=0.0)
    other = most_likely(x, RATE, (10.0, 2e-6, 4e-6))
    assert list(found.parameters.values()) == pytest.approx(other, rel=1e-3)
    errors = np.array(list(found.standard_errors.values())) / list(found.parameters.values())
    expected = fisher_errors(*np.array(list(found.parameters.values())) / [RATE, 1, 1], 4000)
    np.testing.assert_allclose(errors, expected, rtol=0.05)


@pytest.mark.slow
def test_the_order_of_terms_and_the_unit_change_nothing():
    _, x = drawn("GM(beta=1.0, sigma2=2.0) + GM(beta=40.0, sigma2=3.0) + WN(sigma2=0.5) + RW(gamma2=1e-3)")
    one = fit_ml("2*GM + WN + RW", x, RATE)
    other = fit_ml("RW + GM + WN + GM", x, RATE)
    assert dict(other.parameters) == pytest.approx(dict(one.parameters), rel=1e-4)
    assert one.parameters["GM[1].beta"] > one.parameters["GM[2].beta"]
    small = fit_ml("2*GM + WN + RW", 1e-7 * x, RATE)
    for name, value in one.parameters.items():
        assert small.parameters[name] == pytest.approx(value * (1 if name.endswith("beta") else 1e-14), rel=1e-4)
    assert (small.level, one.level) == (None, None)


@pytest.mark.slow
def test_held_parameters_stay():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)")
    free = fit_ml("GM + WN", x, RATE)
    for held in ("GM.beta", "WN.sigma2"):
        term, name = held.split(".")
        text = "GM + WN".replace(term, f"{term}({name}=fixed({1.03 * free.parameters[held]!r}))")
        found = fit_ml(text, x, RATE)
        assert found.parameters[held] == 1.03 * free.parameters[held]
        assert held not in found.standard_errors
        assert held not in found.confidence_intervals()
        assert len(found.names) == 2
        assert found.loglikelihood < free.loglikelihood
        # At the value where it would be anyway nothing is lost, and the others stay where they were.
        same = fit_ml(text.replace(repr(1.03 * free.parameters[held]), repr(free.parameters[held])), x, RATE)
        assert same.loglikelihood == pytest.approx(free.loglikelihood, abs=1e-6)
        assert dict(same.parameters) == pytest.approx(dict(free.parameters), rel=1e-3)
    both = fit_ml("GM(beta=fixed(5.0), sigma2=fixed(0.5)) + WN", x, RATE)
    assert (both.names, both.parameters["GM.sigma2"]) == (("WN.sigma2",), 0.5)
    # A start's value of what is held does not count.
    text = f"GM(beta=fixed({1.1 * free.parameters['GM.beta']!r})) + WN"
    assert fit_ml(text, x, RATE, start=free).parameters["GM.beta"] == 1.1 * free.parameters["GM.beta"]


@pytest.mark.slow
def test_an_unsupported_term_is_zero_and_has_a_remark():
    seen = 0
    for seed in range(10):
        x = Model.parse("WN(sigma2=1.0)").simulate(4000, RATE, rng=seed)
        bare = fit_ml("WN", x, RATE)
        with warnings.catch_warnings(record=True) as said:
            warnings.simplefilter("always")
            found = fit_ml("WN + RW", x, RATE)
        assert found.loglikelihood >= bare.loglikelihood - 1e-6
        if found.parameters["RW.gamma2"] > 0:
            continue
        seen += 1
        assert found.diagnostics.not_supported == ("RW",)
        warned = [w.message.remark for w in said if isinstance(w.message, FitWarning)]
        assert only(warned, "term-zero:fit").facts["term"] == "RW"
        assert found.parameters["WN.sigma2"] == pytest.approx(bare.parameters["WN.sigma2"], rel=1e-4)
        assert "RW.gamma2" not in found.standard_errors
        low, high = found.confidence_intervals()["RW.gamma2"]
        assert low == 0
        # As likely at the upper limit as the level of the interval says.
        held = fit_ml(f"WN + RW(gamma2=fixed({high!r}))", x, RATE)
        assert 2 * (found.loglikelihood - held.loglikelihood) == pytest.approx(1.959964**2, rel=0.02)
    assert seen >= 2


@pytest.mark.slow
def test_a_process_too_slow_for_the_record_is_said_to_be_a_walk():
    for seed in range(5, 8):
        x = Model.parse("RW(gamma2=1e-2) + WN(sigma2=1.0)").simulate(4000, RATE, rng=seed)
        with pytest.warns(FitWarning) as caught:
            found = fit_ml("GM + WN", x, RATE)
        facts = only((w.message.remark for w in caught), "correlation-time-unknown:fit").facts
        assert (facts["term"], facts["process"]) == ("GM", "RW")
        assert found.diagnostics.acts_as == {"GM": "RW"}
        assert found.diagnostics.converged
        assert found.diagnostics.evaluations < 30
        walk = fit_ml("RW + WN", x, RATE)
        # γ² = 2 s² λ, and the same likelihood but for what is left of λ.
        assert found.loglikelihood == pytest.approx(walk.loglikelihood, abs=0.01)
        steps = 2 * found.parameters["GM.sigma2"] * found.parameters["GM.beta"] / RATE
        assert steps == pytest.approx(walk.parameters["RW.gamma2"], rel=1e-2)
        assert found.parameters["WN.sigma2"] == pytest.approx(walk.parameters["WN.sigma2"], rel=1e-3)
        assert found.confidence_intervals()["GM.beta"][0] == 0


def test_a_process_next_to_a_walk_is_known_to_be_little_known():
    # Without the level, of which a slow process is the better part, the information says next to nothing of β.
    x = Model.parse("RW(gamma2=1e-2) + WN(sigma2=1.0)").simulate(4000, RATE, rng=3)
    with pytest.warns(FitWarning) as caught:
        found = fit_ml("GM + WN", x, RATE)
    facts = only((w.message.remark for w in caught), "few-correlation-times").facts
    assert (facts["term"], facts["count"]) == ("GM", pytest.approx(0.54, abs=0.005))
    assert found.diagnostics.converged
    assert found.parameters["GM.beta"] < 0.05
    low, high = found.confidence_intervals()["GM.beta"]
    assert low < 1e-3
    assert high > 0.1


@pytest.mark.parametrize("mean", [None, 0.0])
def test_a_drift_has_the_slope_of_generalised_least_squares(mean):
    model = Model.parse("DR(omega=-0.01) + WN(sigma2=4.0)")
    x = model.simulate(2000, RATE, rng=4)
    found = fit_ml("DR + WN", x, RATE, mean=mean)
    t = np.arange(x.size)
    design = np.vstack([t, np.ones_like(t)] if mean is None else [t]).T
    expected = np.linalg.lstsq(design, x, rcond=None)[0]
    assert found.parameters["DR.omega"] == pytest.approx(expected[0], rel=1e-8)
    rest = x - design @ expected
    # A level is integrated out and takes its degree of freedom with it; a slope is estimated.
    assert found.parameters["WN.sigma2"] == pytest.approx(rest @ rest / (x.size - (mean is None)), rel=1e-6)
    spread = found.parameters["WN.sigma2"] * np.linalg.inv(design.T @ design)
    assert found.standard_errors["DR.omega"] == pytest.approx(np.sqrt(spread[0, 0]), rel=1e-6)
    if mean is None:
        assert found.level == pytest.approx(expected[1], rel=1e-6, abs=1e-9)
        assert found.level_error == pytest.approx(np.sqrt(spread[1, 1]), rel=1e-6)
    held = fit_ml("DR(omega=fixed(-0.01)) + WN", x, RATE, mean=mean)
    assert held.parameters["DR.omega"] == -0.01
    assert held.loglikelihood <= found.loglikelihood


def test_the_mean_of_white_noise_is_the_average():
    _, x = drawn("WN(sigma2=2.0)", samples=500)
    found = fit_ml("WN", x, RATE)
    assert found.level == pytest.approx(x.mean(), rel=1e-12)
    assert found.parameters["WN.sigma2"] == pytest.approx(np.var(x, ddof=1), rel=1e-6)
    assert found.level_error == pytest.approx(np.std(x, ddof=1) / np.sqrt(x.size), rel=1e-6)
    assert found.standard_errors["WN.sigma2"] == pytest.approx(np.var(x) * np.sqrt(2 / x.size), rel=2e-2)
    assert found.aic == 2 - 2 * found.loglikelihood
    assert found.bic == pytest.approx(np.log(500) - 2 * found.loglikelihood)
    known = fit_ml("WN", x, RATE, mean=9.81)
    assert known.level is None
    assert known.parameters["WN.sigma2"] == pytest.approx(np.mean((x - 9.81) ** 2), rel=1e-6)


@pytest.mark.slow
def test_profile_intervals_end_where_the_likelihood_has_fallen():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)", samples=3000)
    found = fit_ml("GM + WN", x, RATE)
    wald = found.confidence_intervals()
    problem, z, _ = top(found, x)
    places = {"GM.sigma2": 0, "GM.beta": 1, "WN.sigma2": 2}
    profile = found.confidence_intervals(method="profile")
    assert set(profile) == set(places)
    for name, k in places.items():
        others = [i for i in range(3) if i != k]
        for end, near in zip(profile[name], wald[name], strict=True):
            at = z.copy()
            # Where the coordinate is that alone stands for this parameter, for the other shape moves it not.
            at[k] += np.log(end / found.parameters[name])

            def fallen(free, at=at, others=others):
                at[others] = free
                return 2 * (found.loglikelihood - problem.value(problem.at_point(at))[0])

            best = minimize(fallen, z[others], method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-5})
            assert best.fun == pytest.approx(1.959964**2, rel=0.01), name
            assert end == pytest.approx(near, rel=0.25)
    narrow, wide = (found.confidence_intervals(level) for level in (0.5, 0.99))
    for name in wald:
        ends = [wide[name][0], wald[name][0], narrow[name][0], narrow[name][1], wald[name][1], wide[name][1]]
        assert ends == sorted(set(ends))
        assert ends[2] < found.parameters[name] < ends[3]
    with raises(OptionError, "'wald' or 'profile'", argument="method", got="bootstrap"):
        found.confidence_intervals(method="bootstrap")


def test_plain_numbers_and_back():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)")
    found = fit_ml("GM + WN", Signal(x, RATE, unit="m/s²", axis="accel_z"))
    text = json.dumps(found.to_dict(), allow_nan=False)
    back = LikelihoodFit.from_dict(json.loads(text))
    assert json.dumps(back.to_dict(), allow_nan=False) == text
    assert back.confidence_intervals() == found.confidence_intervals()
    # A fit from a file has no recording, and so no residuals.
    expected = [line for line in found.summary().splitlines() if not line.startswith("residuals")]
    assert back.summary().splitlines() == expected
    # In a notebook the same, as a table: a row for each parameter, and one of titles.
    for one in (found, back):
        html = one._repr_html_()
        assert html.count("<tr>") == 4
        assert "by maximum likelihood" in html
        assert "<td>GM.beta</td>" in html
        assert ("(Ljung-Box" in html) == (one is found)
    assert (back.axis, back.unit, back.level) == ("accel_z", "m/s²", found.level)
    np.testing.assert_array_equal(back.covariance, found.covariance)
    np.testing.assert_allclose(back.smooth(x).mean["bias"], found.smooth(x).mean["bias"])
    with raises(ModelError, "GM.beta", "recording"):
        back.confidence_intervals(method="profile")
    for key in ("model", "covariance", "samples"):
        with raises(ReadError, f"'{key}'", advises=["to_dict()"]):
            LikelihoodFit.from_dict({k: v for k, v in found.to_dict().items() if k != key})
    with raises(ReadError, "parameters", back.model):
        LikelihoodFit.from_dict(found.to_dict() | {"parameters": {"WN.sigma2": 1.0}})


def test_a_zero_and_an_infinity_survive_plain_numbers():
    x = Model.parse("RW(gamma2=1e-2) + WN(sigma2=1.0)").simulate(2000, RATE, rng=3)
    with pytest.warns(FitWarning):
        found = fit_ml("GM + WN", x, RATE)
    assert only(found.remarks, "correlation-time-unknown:fit").facts["process"] == "RW"
    back = LikelihoodFit.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False)))
    assert back.diagnostics == found.diagnostics
    np.testing.assert_array_equal(back.covariance, found.covariance)


def test_progress_is_reported():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)", samples=2000)
    reported = []
    found = fit_ml("GM + WN", x, RATE, progress=lambda count, value: reported.append((count, value)))
    assert [count for count, _ in reported] == list(range(1, found.diagnostics.evaluations + 1))
    assert max(value for _, value in reported) == pytest.approx(found.loglikelihood, rel=1e-12)
    assert reported[0][1] == pytest.approx(found.diagnostics.started_at, rel=1e-12)


def test_the_same_data_give_the_same_fit():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0) + RW(gamma2=1e-3)", samples=2000)
    texts = {json.dumps(fit_ml("GM + WN + RW", x.copy(), RATE).to_dict()) for _ in range(2)}
    assert len(texts) == 1


def good():
    return Model.parse("WN(sigma2=1.0)").simulate(100, RATE, rng=1)


@each(
    ("model", "data", "options", "error", "facts"),
    [
        ("WN", np.full(100, np.inf), {}, DataError, ("100 infinite", "index 0")),
        ("WN", np.full(100, np.nan), {}, DataError, (8, "0 of 100")),
        ("WN", np.full(100, 3.0), {}, ModelError, ("constant",)),
        ("WN", good()[:7], {}, DataError, (8, 7)),
        ("WN", good().reshape(10, 10), {}, DataError, ("data", "(10, 10)")),
        ("WN", good(), {"rate": -1.0}, OptionError, ("rate",)),
        ("WN", Signal(good(), RATE), {"rate": 50.0}, OptionError, ("rate", 100, 50)),
        ("WN", good(), {"mean": "none"}, OptionError, ("mean", "finite", "'none'")),
        ("WN", good(), {"mean": np.nan}, OptionError, ("mean", "finite", np.nan)),
        ("PL + WN", good(), {"start": "PL(alpha=2.5, nu2=1.0) + WN(sigma2=1.0)"}, MissingTheoryError, ("PL", "0 to 2")),
        ("WN", good(), {"start": "RW(gamma2=1.0)"}, ModelError, ("start", "WN", "RW")),
        ("WN + RW", good(), {"start": "WN(sigma2=1.0)"}, ModelError, ("start", "WN + RW", "got WN")),
        ("WN + RW", good(), {"start": "WN(sigma2=1.0) + RW"}, ModelError, ("start", "RW.gamma2")),
        ("WN(sigma2=fixed(1.0))", good(), {}, ModelError, ("WN(sigma2=fixed(1.0))", "fixed")),
        ("SIN", good(), {"start": "SIN(frequency=7.0, power=1.0)"}, ModelError, ("SIN(frequency=7.0", "exactly")),
        ("AR(2, phi1=fixed(0.5), sigma2=1.0)", good(), {"start": "AR(2, phi1=0.5, phi2=0.1, sigma2=1.0)"}, ModelError,
         ("AR(2)", "fixed", "free")),
    ],
)  # fmt: skip
def test_errors_name_the_cause(model, data, options, error, facts):
    given = {"rate": None if isinstance(data, Signal) else RATE} | options
    with raises(error, *facts):
        fit_ml(model, data, **given)


def test_missing_samples_may_be_masked():
    x = good()
    x[[3, 50]] = np.nan
    masked = np.ma.masked_invalid(x)
    assert Model.parse("WN(sigma2=1.0)").loglikelihood(masked, RATE) == Model.parse("WN(sigma2=1.0)").loglikelihood(
        x, RATE
    )
    assert fit_ml("WN", x, RATE).missing == 2


def test_a_value_is_needed_of_each_parameter():
    with raises(ModelError, "WN.sigma2", advises=["gmwm.fit_ml"]):
        Model.parse("WN").loglikelihood(good(), RATE)


def test_a_wavelet_fit_is_a_start():
    _, x = drawn("GM(beta=5.0, sigma2=0.5) + WN(sigma2=1.0)")
    begun = fit("GM + WN", x, RATE)
    found = fit_ml("GM + WN", x, RATE, start=begun)
    assert found.diagnostics.started_at == pytest.approx(begun.model.loglikelihood(x, RATE), rel=1e-12)
    assert found.loglikelihood > found.diagnostics.started_at


def test_errors_are_in_the_order_of_the_model():
    model, x = drawn("GM(beta=1.0, sigma2=2.0) + GM(beta=40.0, sigma2=3.0) + WN(sigma2=0.5)")
    found = fit_ml(model.structure, x, RATE, start=model)
    assert list(found.names) == list(found.model.names) == list(found.standard_errors)
    swapped = fit_ml(
        model.structure, x, RATE, start="GM(beta=40.0, sigma2=3.0) + GM(beta=1.0, sigma2=2.0) + WN(sigma2=0.5)"
    )
    assert swapped.names == found.names
    np.testing.assert_allclose(swapped.covariance, found.covariance, rtol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("larger", ["2*GM + WN + RW", "2*GM + WN + QN + RW"])
def test_a_larger_model_has_no_smaller_likelihood(larger):
    # A process that is gone within a sample: to the wavelet variance it is white, and the other terms are at zero.
    x = Model.parse("GM(beta=150.0, sigma2=1.0) + RW(gamma2=1e-6)").simulate(5000, RATE, rng=2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        small, large = fit_ml("GM + WN + RW", x, RATE), fit_ml(larger, x, RATE)
    assert large.diagnostics.converged
    assert large.loglikelihood > small.loglikelihood - 1e-6


def test_terms_that_start_together_come_apart():
    model, x = drawn("GM(beta=1.0, sigma2=2.0) + GM(beta=40.0, sigma2=3.0) + WN(sigma2=0.5)")
    apart = fit_ml(model.structure, x, RATE, start=model)
    together = fit_ml(model.structure, x, RATE, start="2*GM(beta=5.0, sigma2=2.0) + WN(sigma2=0.5)")
    assert together.loglikelihood == pytest.approx(apart.loglikelihood, abs=1e-6)


def test_a_recording_is_not_one_axis():
    imu = Imu.from_arrays({"gyro_x": np.arange(20.0), "gyro_y": np.arange(20.0)}, RATE)
    with raises(DataError, "gyro_x, gyro_y", argument="data", advises=["imu['gyro_x']"]):
        fit_ml("WN", imu)


def test_a_known_mean_leaves_a_walk_its_level_wherever_it_starts():
    x = 9.81 + Model.parse("WN(sigma2=1.0) + RW(gamma2=1e-3)").simulate(3000, RATE, rng=1)
    zero, there = (
        fit_ml("WN + RW", x, RATE, mean=0.0, start=f"WN(sigma2=1.0) + RW(gamma2={walk})") for walk in (0.0, 1e-3)
    )
    assert zero.loglikelihood == pytest.approx(there.loglikelihood, abs=1e-6)
    assert zero.parameters["RW.gamma2"] == pytest.approx(there.parameters["RW.gamma2"], rel=1e-3)


def test_a_walk_at_zero_leaves_the_mean_to_the_record():
    x = 9.81 + Model.parse("WN(sigma2=1.0)").simulate(3000, RATE, rng=3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FitWarning)
        found = fit_ml("WN + RW", x, RATE)
    assert found.diagnostics.not_supported == ("RW",)
    assert found.level == pytest.approx(x.mean(), rel=1e-9)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")
def test_a_profile_ends_where_the_other_parameters_run_away():
    # Ten correlation times: next to a random walk, σ² grows beyond all doubles on the way to the upper end.
    x = Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0)").simulate(500, RATE, rng=20_361_245)
    found = fit_ml("GM + WN", x, RATE)
    for name, (low, high) in found.confidence_intervals(method="profile").items():
        assert low < found.parameters[name] < high, name
