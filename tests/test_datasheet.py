"""The numbers of a fit in the terms of datasheets."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

import gmwm
from gmwm import AR1, DR, GM, QN, RW, SIN, WN, Model, Signal, WaveletVariance, fixed
from gmwm.base.errors import OptionError
from gmwm.base.units import datasheet_units, noise_unit
from gmwm.choosing.datasheets import Datasheet, Entry, model_datasheet, with_limits
from gmwm.choosing.datasheets.bias import lowest
from gmwm.choosing.datasheets.filter_numbers import filter_numbers
from gmwm.theory.processes import Process, registry
from gmwm.theory.processes.parameter import Parameter, Value
from tests.helpers import code_of, codes, only, raises

pytestmark = pytest.mark.filterwarnings("ignore::gmwm.errors.FitWarning")

RATE = 100.0
FULL = Model.parse(
    "GM(0.5, 1e-8) + GM(beta=20, sigma2=4e-8) + WN(sigma2=1e-6) + QN(q2=1e-6) + RW(gamma2=1e-13) + DR(-2e-9)"
)
FLOOR = math.sqrt(2 * math.log(2) / math.pi)


def exact(
    model: Model | Process, unit: str = "rad/s", axis: str = "gyro_x", levels: int = 16, samples: int = 2**18
) -> WaveletVariance:
    """The wavelet variance of a model itself, as if it had been measured."""
    model = Model((model,)) if isinstance(model, Process) else model
    drift = [p.value("omega") for p in model.processes if isinstance(p, DR)]
    wv = WaveletVariance.from_values(
        model.wavelet_variance(levels, RATE), samples=samples, rate=RATE, unit=unit, axis=axis
    )
    return replace(wv, slope=drift[0]) if drift else wv


def sheet_of(model: Model | Process | str, wv: WaveletVariance, **options: object) -> Datasheet:
    return gmwm.fit(model, wv, **options).datasheet()


def near(x: float, rel: float = 1e-6) -> object:
    return pytest.approx(x, rel=rel, abs=0)


# --- the numbers --------------------------------------------------------------------------------------


@pytest.mark.parametrize(("ratio", "repeated"), [(1.04, True), (0.96, True), (1.06, False), (0.94, False)])
def test_a_number_of_a_term_is_left_out_within_five_per_cent_of_the_number_of_a_filter(ratio, repeated):
    truth = Model.parse("WN(sigma2=1e-6) + RW(gamma2=1e-12)")
    fit = gmwm.fit("WN + RW", exact(truth))
    sheet = model_datasheet(fit, 0.95)
    of_filter = sheet["N"].value
    entries = [replace(e, value=ratio * of_filter) if e.symbol == "N of WN" else e for e in sheet.entries]
    assert ("N of WN" not in with_limits(replace(sheet, entries=tuple(entries)), fit)) == repeated


def test_numbers_are_those_of_the_formulas():
    found = sheet_of(FULL.structure, exact(FULL))
    wanted = {
        "Q": math.sqrt(1e-6) / RATE,
        "N of WN": 1e-4,
        "K of RW": math.sqrt(1e-13 * RATE),
        "R": -2e-9 * RATE,
        "T_c[1]": 1 / 20.0,
        "q_c[1]": math.sqrt(2 * 20.0 * 4e-8),
        "T_c[2]": 1 / 0.5,
        "q_c[2]": math.sqrt(2 * 0.5 * 1e-8),
    }
    assert list(found)[:5] == ["N", "K", "B", "Q", "R"]
    assert set(found) == {"N", "K", "B", *wanted}
    numbers = filter_numbers(FULL.processes, RATE)
    assert (found["N"].value, found["K"].value) == near((numbers.N, numbers.K), 1e-4)
    for symbol, value in wanted.items():
        assert found[symbol].value == near(value, 1e-4), symbol
    assert {symbol: entry.unit for symbol, entry in found.items()} == {
        "Q": "rad", "N": "rad/s/√Hz", "B": "rad/s", "K": "rad/s/√s", "R": "rad/s²",
        "T_c[1]": "s", "q_c[1]": "rad/s/√s", "T_c[2]": "s", "q_c[2]": "rad/s/√s",
        "N of WN": "rad/s/√Hz", "K of RW": "rad/s/√s",
    }  # fmt: skip
    assert (found["N"].term, found["q_c[2]"].term, found["B"].term) == (None, "GM[2]", None)
    assert (found.axis, found.model, found.samples, found.horizon) == (
        "gyro_x",
        "2*GM + WN + QN + RW + DR",
        2**18,
        327.68,
    )


def test_a_number_of_one_parameter_has_the_ends_of_its_interval():
    fit = gmwm.fit("GM + WN + RW", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6) + RW(gamma2=1e-13)))
    for level in (0.5, 0.95):
        ends, found = fit.confidence_intervals(level), fit.datasheet(level)
        low, high = ends["WN.sigma2"]
        white = found["N of WN"]
        assert (white.low, white.high) == near((math.sqrt(low / RATE), math.sqrt(high / RATE)))
        low, high = ends["GM.beta"]
        assert (found["T_c"].low, found["T_c"].high) == near((1 / high, 1 / low))
    with raises(OptionError, "level", 95):
        fit.datasheet(95)


def test_the_interval_of_a_product_knows_the_correlation():
    fit = gmwm.fit("GM + WN", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)))
    found, cov = fit.datasheet()["q_c"], fit.sandwich.relative
    b, s = fit.sandwich.names.index("GM.beta"), fit.sandwich.names.index("GM.sigma2")
    error = 0.5 * math.sqrt(cov[b, b] + cov[s, s] + 2 * cov[b, s])
    assert found.high / found.value == near(math.exp(1.959963985 * error))
    assert found.low * found.high == near(found.value**2)


@pytest.mark.parametrize(("beta", "contained"), [(5.0, False), (25.0, True)])
def test_the_white_noise_of_a_term_names_the_fast_markov_term_that_n_contains(beta, contained):
    fit = gmwm.fit("GM + WN", exact(GM(beta=beta, sigma2=1e-5) + WN(sigma2=1e-6)))
    assert fit.datasheet()["N of WN"].title.endswith(", without GM, which N contains") == contained


def test_the_two_ways_to_write_a_markov_process_have_one_datasheet():
    truth = GM(beta=2.0, sigma2=1e-8) + WN(sigma2=1e-6)
    a, b = (sheet_of(text, exact(truth)) for text in ("GM + WN", "AR1 + WN"))
    assert list(a) == list(b) == ["N", "K", "B", "T_c", "q_c", "N of WN"]
    for symbol in a:
        assert (b[symbol].value, b[symbol].low, b[symbol].high) == near(
            (a[symbol].value, a[symbol].low, a[symbol].high), 1e-4
        )


@pytest.mark.parametrize("model", [WN(sigma2=2.0), QN(q2=2.0), RW(gamma2=2.0), DR(omega=-2.0), GM(beta=3.0, sigma2=2.0),
                                   AR1(phi=0.9, sigma2=2.0), AR1(phi=0.999, sigma2=2.0)], ids=str)  # fmt: skip
def test_slopes_are_derivatives(model):
    step = 1e-6
    for k, number in enumerate(model.physical(RATE)):
        for name, slope in number.slopes.items():
            at = model.value(name)
            low, high = (model.with_values(**{name: at * math.exp(s * step)}).physical(RATE)[k].value for s in (-1, 1))
            assert math.log(high / low) / (2 * step) == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_what_has_no_meaning_is_left_out_and_said():
    assert AR1(phi=-0.5, sigma2=1.0).physical(RATE) == ()
    assert Process.physical(WN(sigma2=1.0), RATE) == ()
    found = sheet_of("AR1 + WN", exact(AR1(phi=-0.8, sigma2=1e-6) + WN(sigma2=1e-6)))
    assert list(found) == ["N", "K", "B", "N of WN"]
    facts = only(found.remarks, "no-number:term").facts
    assert (facts["term"], facts["because"]) == ("AR1", "none")
    with pytest.raises(KeyError, match=r"no Q; .* N, K, B"):
        found["Q"]
    assert found.get("Q") is None


@dataclass(frozen=True, repr=False)
class Own(Process, register=False):
    name = "Own"
    title = "First-order moving average"
    parameters = (
        Parameter("theta", "θ", "moving average coefficient", domain="real"),
        Parameter("sigma2", "σ²", "innovation variance", signal_power=2, scale_power=1),
    )

    theta: Value = None
    sigma2: Value = None

    def autocovariance(self, lags, rate):
        k, theta = np.abs(np.asarray(lags)), self.value("theta")
        return self.scale * np.where(k == 0, 1 + theta**2, np.where(k == 1, theta, 0.0))


@pytest.mark.slow
def test_a_process_of_ones_own_may_say_nothing():
    own = Own(theta=fixed(0.5))
    found = sheet_of(own + RW(), exact(Own(theta=0.5, sigma2=1e-6) + RW(gamma2=1e-10), levels=9, samples=2**12))
    assert list(found) == ["N", "K", "B"]
    facts = only(found.remarks, "no-number:term").facts
    assert (facts["term"], facts["because"]) == ("Own", "none")
    # The density of a process without one comes from its wavelet variance.
    assert found["N"].value == near(1.5e-3 / 10, 0.05)
    assert found["K"].value == near(1e-4, 0.05)


# --- bias instability ---------------------------------------------------------------------------------


def test_bias_of_white_noise_and_a_walk():
    n, k = 1e-4, 1e-5
    found = sheet_of("WN + RW", exact(WN(sigma2=n**2 * RATE) + RW(gamma2=k**2 / RATE)))["B"]
    # N²/τ + K²τ/3 is lowest at τ = √3 N/K, where it is 2NK/√3.
    assert found.tau == pytest.approx(math.sqrt(3) * n / k, abs=1 / RATE)
    assert found.value == near(math.sqrt(2 * n * k / math.sqrt(3)) / FLOOR, 1e-4)
    assert not found.upper_only


def test_bias_of_white_noise_and_a_walk_has_the_error_of_their_product():
    fit = gmwm.fit("WN + RW", exact(WN(sigma2=1e-6) + RW(gamma2=1e-12)))
    found, cov = fit.datasheet()["B"], fit.sandwich.relative
    # B² is as NK, so ln B = (ln σ² + ln γ²)/4 + …
    error = 0.25 * math.sqrt(cov.sum())
    assert found.high / found.value == near(math.exp(1.959963985 * error), 1e-5)


def test_bias_that_the_data_only_bound():
    falling = sheet_of("WN", exact(WN(sigma2=1e-6)))
    assert falling["B"].upper_only
    assert falling["B"].tau == falling.horizon
    assert falling["B"].value == near(1e-4 / math.sqrt(falling.horizon) / FLOOR)
    assert (falling["B"].low, falling["B"].text()[:2]) == (0.0, "≤ ")
    assert only(falling.remarks, "b-limit").facts["because"] == "falls"
    rising = sheet_of("RW", exact(RW(gamma2=1e-12)))
    assert rising["B"].upper_only
    assert rising["B"].tau == 1 / RATE
    assert only(rising.remarks, "b-limit").facts["because"] == "rises"
    # A walk so weak that it might be none: its minimum is not to be relied on.
    doubtful = sheet_of("WN + RW", exact(WN(sigma2=1e-6) + RW(gamma2=6e-15)))
    assert doubtful["B"].tau < doubtful.horizon
    assert doubtful["B"].upper_only
    assert doubtful["K"].upper_only
    assert only(doubtful.remarks, "b-limit").facts["because"] == "unsure"


@pytest.mark.parametrize("last", [1, 2, 3, 7, 1000, 2**20])
def test_lowest_finds_every_whole_number(last):
    for at in {1, 2, last // 3 + 1, last // 2 + 1, last - 1, last} & set(range(1, last + 1)):
        assert lowest(lambda n, at=at: np.log(n / at) ** 2, last) == at


def test_lowest_of_two_valleys():
    assert lowest(lambda n: np.minimum((np.log2(n) - 4) ** 2, (np.log2(n) - 12) ** 2 - 0.1), 2**16) == 2**12


@pytest.mark.parametrize("process", registry.values(), ids=registry.keys())
def test_allan_variance_is_twice_the_wavelet_variance(process):
    values = {"phi": 0.95, "beta": 3.0, "omega": -2.0}
    free = process.nonlinear_parameters()
    middle = process.at_coordinates(process.scan(1000, RATE).mean(axis=1).reshape(1, -1))[0] if free else ()
    values = {p.name: float(v) for p, v in zip(free, middle, strict=True)} | values
    one = process(**{p.name: values.get(p.name, 2.0) for p in process.parameters})
    clusters = 2 ** np.arange(14)
    np.testing.assert_allclose(
        one.allan_variance(clusters, RATE), 2 * one.wavelet_variance(14, RATE), rtol=1e-9, atol=0
    )
    if process.has("running_sum_covariance"):
        sizes = np.array([[1, 3], [100, 77]])
        found = one.allan_variance(sizes, RATE)
        np.testing.assert_allclose(found, Process.allan_variance(one, sizes, RATE), rtol=1e-9)
        assert found.shape == (2, 2)
    with raises(OptionError, "clusters"):
        one.allan_variance([0, 1], RATE)
    with raises(OptionError, "clusters"):
        one.allan_variance([1.5], RATE)


def test_allan_variance_of_a_negative_coefficient():
    one = AR1(phi=-0.7, sigma2=2.0)
    np.testing.assert_allclose(
        one.allan_variance(2 ** np.arange(8), RATE), 2 * one.wavelet_variance(8, RATE), rtol=1e-9
    )


# --- terms that are zero, held, or act as others -------------------------------------------------------


def test_zero_terms_are_upper_limits():
    fit = gmwm.fit("WN + RW + QN + DR", exact(WN(sigma2=1e-6)))
    found, ends = fit.datasheet(), fit.confidence_intervals()
    assert found["K"].value == pytest.approx(0.0, abs=found["K"].high)
    assert found["K"].upper_only
    assert found["Q"].upper_only
    assert found["R"].upper_only
    assert not found["N"].upper_only
    assert found["K"].high == near(math.sqrt(ends["RW.gamma2"][1] * RATE))
    assert found["R"].high == near(ends["DR.omega"][1] * RATE)
    assert found["R"].low == -found["R"].high
    assert found["K"].text().startswith("≤ ")
    assert found["R"].text().startswith("within ±")


def test_a_zero_markov_term_has_no_numbers():
    rng = np.random.default_rng(5)
    fit = next(
        f for f in (gmwm.fit("2*GM + WN", rng.normal(size=4000), rate=RATE) for _ in range(20))
        if any(t.startswith("GM") for t in f.diagnostics.not_supported)
    )  # fmt: skip
    term = next(t for t in fit.diagnostics.not_supported if t.startswith("GM"))
    found = fit.datasheet()
    assert term.replace("GM", "T_c") not in found
    assert (term, "zero") in [
        (r.facts["term"], r.facts["because"]) for r in found.remarks if code_of(r) == "no-number:term"
    ]


def test_held_parameters_are_said_to_be_held():
    wv = exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6))
    found = sheet_of(GM(beta=fixed(0.5)) + WN(sigma2=fixed(1e-6)), wv)
    white = found["N of WN"]
    assert white.held
    assert white.low == white.high == white.value == near(1e-4)
    assert white.text().endswith("deg/√h (fixed)")
    assert not found["N"].held
    assert found["T_c"].held
    assert not found["q_c"].held
    assert found["q_c"].low < found["q_c"].value < found["q_c"].high


@pytest.mark.parametrize(("beta", "name", "symbol"), [(1e8, "WN", "N"), (1e-9, "RW", "K")])
def test_a_term_that_acts_as_another_gives_the_same_numbers(beta, name, symbol):
    plain = exact(WN(sigma2=1e-6) + RW(gamma2=1e-12))
    beside = "RW" if name == "WN" else "WN"
    fit, apart = gmwm.fit(f"GM + {beside}", plain, weighting="optimal"), gmwm.fit("WN + RW", plain, weighting="optimal")
    if name == "WN":
        assert fit.diagnostics.acts_as == {"GM": name}
    fit = replace(
        fit,
        model=fit.model.with_values(
            {"GM.beta": beta, "GM.sigma2": 1e-6 if name == "WN" else 1e-12 * RATE / (2 * beta)}
        ),
        diagnostics=replace(fit.diagnostics, acts_as={"GM": name}),
    )
    found, wanted = fit.datasheet(), apart.datasheet()
    assert set(found) == {"N", "B", "K"}
    (remark,) = found.remarks
    assert (code_of(remark), remark.facts) == (
        "no-number:term",
        {"case": "term", "term": "GM", "because": "acts", "process": name},
    )
    for key in wanted:
        assert found[key].value == near(wanted[key].value, 1e-3)
        assert (found[key].low, found[key].high) == near((wanted[key].low, wanted[key].high), 5e-3)


def test_without_theory_there_are_numbers_but_no_intervals():
    fit = gmwm.fit("DR", exact(DR(omega=1e-6)))
    found = fit.datasheet()
    assert found["R"].value == near(1e-4)
    assert (found["R"].low, found["R"].high) == (None, None)
    assert found["R"].text("si") == "1.000e-04 rad/s²"
    assert codes(found.remarks)[0] == "no-intervals"
    assert Datasheet.from_dict(json.loads(json.dumps(found.to_dict())))["R"] == found["R"]


@pytest.mark.slow
def test_datasheets_have_frequency_and_amplitude_and_no_minimum_of_the_line():
    truth = WN(sigma2=1e-6) + SIN(frequency=0.7, power=8e-6)
    found = gmwm.fit(truth.structure, exact(truth)).datasheet()
    assert list(found) == ["N", "K", "B", "N of WN", "f_0", "A"]
    assert found["f_0"].text("si").endswith(" Hz")
    assert found["f_0"].value == near(0.7)
    assert found["A"].value == near(4e-3)
    assert found["f_0"].low < 0.7 < found["f_0"].high
    # The curve of white noise falls to its end; the zeros of the line are no minimum.
    assert found["B"].upper_only
    alone = gmwm.fit("WN", exact(WN(sigma2=1e-6))).datasheet()
    assert found["B"].value == near(alone["B"].value)
    assert only(found.remarks, "b-limit").facts["because"] == "falls"
    two = gmwm.fit("2*SIN + WN", exact(truth + SIN(frequency=20.0, power=2e-6))).datasheet()
    assert [two[f"f_0[{k}]"].value for k in (1, 2)] == [near(0.7), near(20.0)]
    assert [two[f"A[{k}]"].value for k in (1, 2)] == [near(4e-3), near(2e-3)]
    line = gmwm.fit("SIN", exact(SIN(frequency=0.7, power=8e-6))).datasheet()
    assert list(line) == ["N", "K", "f_0", "A"]
    assert only(line.remarks, "no-number:b").facts["reason"] == "SIN has no noise"


def test_a_flicker_term_that_is_zero_leaves_the_lowest_point_of_the_curve():
    found = sheet_of("WN + FN + RW", exact(WN(sigma2=1e-6) + RW(gamma2=1e-12)))
    assert (found["B"].term, found["B"].upper_only) == (None, False)
    assert found["B"].tau is not None
    assert found["B_f"].upper_only


# --- two numbers for a filter -------------------------------------------------------------------------


def test_the_numbers_are_those_of_the_model_for_each_horizon():
    fit = gmwm.fit(FULL.structure, exact(FULL))
    for horizon in (0.01, 1.0, 100.0):
        found = gmwm.datasheets.effective_noise(fit, horizon)
        wanted = filter_numbers(fit.model.processes, RATE, horizon)
        assert (found["N"].value, found["K"].value) == near((wanted.N, wanted.K), 1e-9)
    assert (found["N"].unit, found["K"].unit) == ("rad/s/√Hz", "rad/s/√s")
    assert gmwm.datasheets.effective_noise(fit)["N"] == fit.datasheet()["N"]
    for bad in (0.0, -1.0, math.inf, "1 s", True):
        with raises(OptionError, "positive", argument="horizon", got=bad):
            gmwm.datasheets.effective_noise(fit, bad)


def test_white_noise_and_a_walk_have_their_own_intervals_at_each_horizon():
    fit = gmwm.fit("WN + RW", exact(WN(sigma2=1e-6) + RW(gamma2=1e-12)))
    ends = fit.confidence_intervals()
    for horizon in (0.01, 1.0, 30.0):
        found = gmwm.datasheets.effective_noise(fit, horizon)
        assert found["N"].value == near(1e-4, 1e-5)
        for symbol, name, factor in (("N", "WN.sigma2", 1 / RATE), ("K", "RW.gamma2", RATE)):
            low, high = (math.sqrt(factor * end) for end in ends[name])
            assert (found[symbol].low, found[symbol].high) == near((low, high), 1e-4)
    found = gmwm.datasheets.effective_noise(gmwm.fit("WN + RW", exact(WN(sigma2=1e-6))), 1.0)["K"]
    assert found.upper_only
    assert 0 < found.high < 1e-5
    assert found.value == found.high


@pytest.mark.parametrize(
    "text",
    ["GM(beta=0.05, sigma2=2e-8) + WN(sigma2=1e-6)", "FN(b2=3e-9) + WN(sigma2=1e-6)",
     "GM(beta=0.05, sigma2=2e-8) + RW(gamma2=2e-12) + WN(sigma2=1e-6)"],
)  # fmt: skip
def test_the_interval_is_that_of_the_derivatives(text):
    truth = Model.parse(text)
    x = truth.simulate(2**17, RATE, rng=3)
    fit = gmwm.fit(truth.structure, Signal(x, RATE, "rad/s"), certify=False)
    found, cov = gmwm.datasheets.effective_noise(fit), fit.sandwich
    gradient = {"N": [], "K": []}
    step = 1e-4
    for name in cov.names:
        moved = [fit.model.with_values({name: fit.parameters[name] * math.exp(s * step)}) for s in (-1, 1)]
        low, high = (filter_numbers(each.processes, RATE, slowest=2**17) for each in moved)
        for symbol, slopes in gradient.items():
            slopes.append(math.log(getattr(high, symbol) / getattr(low, symbol)) / (2 * step))
    for symbol, slopes in gradient.items():
        error = math.sqrt(np.array(slopes) @ cov.relative @ np.array(slopes))
        if found[symbol].upper_only:
            continue
        # The ends of poorly known parameters may lie outside.
        assert 0.98 < math.log(found[symbol].high / found[symbol].value) / (1.959963985 * error) < 1.1


def test_equivalent_models_have_the_same_numbers():
    # Flicker noise, and five Gauss-Markov terms with nearly the same curve, fitted to the same data.
    truth = WN(sigma2=1e-6) + gmwm.FN(b2=4e-9)
    x = truth.simulate(2**18, RATE, rng=1)
    curve = gmwm.wavelet_variance(Signal(x, RATE, "rad/s"))
    sheets = [gmwm.fit(model, curve, certify=False).datasheet() for model in ("WN + FN", "3*GM + WN", "2*GM + WN + RW")]
    numbers = [(sheet["N"].value, sheet["K"].value) for sheet in sheets]
    for white, walk in numbers[1:]:
        assert white == near(numbers[0][0], 0.02)
        assert walk == near(numbers[0][1], 0.25)


# --- laws ---------------------------------------------------------------------------------------------


def test_the_unit_of_the_data_changes_nothing():
    wv = exact(FULL, "rad/s")
    degrees = exact(FULL, "rad/s")
    factor = math.degrees(1.0)
    degrees = replace(
        wv, unit="deg/s", slope=wv.slope * factor,
        variance=wv.variance * factor**2, lower=wv.lower * factor**2, upper=wv.upper * factor**2,
    )  # fmt: skip
    a, b = sheet_of(FULL.structure, wv), sheet_of(FULL.structure, degrees)
    assert list(a) == list(b)
    for symbol in a:
        assert (b[symbol].value, b[symbol].low, b[symbol].high) == near(
            (a[symbol].value, a[symbol].low, a[symbol].high), 1e-3
        )
        assert b[symbol].unit == a[symbol].unit
    np.testing.assert_allclose(b.allan_deviation, a.allan_deviation, rtol=1e-4)


@pytest.mark.parametrize("power", [-12, 12])
def test_scaling_the_data_scales_the_numbers(power):
    model = GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6) + RW(gamma2=1e-13)
    x = model.simulate(2**15, RATE, rng=3)
    factor = 10.0**power
    a = gmwm.fit("GM + WN + RW", x, rate=RATE).datasheet()
    b = gmwm.fit("GM + WN + RW", factor * x, rate=RATE).datasheet()
    for symbol, entry in a.items():
        by = 1.0 if symbol == "T_c" else factor
        assert (b[symbol].value, b[symbol].low, b[symbol].high) == near(
            (by * entry.value, by * entry.low, by * entry.high), 1e-3
        )


@pytest.mark.parametrize("text", ["WN + RW", "GM + WN", "2*GM + WN + QN + RW + DR"])
def test_the_round_trip_through_json(text):
    found = sheet_of(text, exact(FULL))
    again = Datasheet.from_dict(json.loads(json.dumps(found.to_dict(), allow_nan=False)))
    assert again.to_dict() == found.to_dict()
    assert again.entries == found.entries
    assert again.summary() == found.summary()


def test_what_the_data_do_not_determine_survives_json():
    entry = Entry(symbol="T_c", title="correlation time", value=3.0, low=0.0, high=math.inf, unit="s", term="GM")
    assert Entry.from_dict(json.loads(json.dumps(entry.to_dict(), allow_nan=False))) == entry
    assert entry.text() == "not determined"


TRUTHS = {
    "WN + RW": WN(sigma2=1.0) + RW(gamma2=1e-5),
    "GM + WN": GM(beta=2.0, sigma2=0.1) + WN(sigma2=1.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("text", TRUTHS)
def test_intervals_cover(text):
    truth, paths, n = TRUTHS[text], 120, 2**14
    wanted = {number.symbol: number.value for process in truth.processes for number in process.physical(RATE)}
    numbers = filter_numbers(truth.processes, RATE)
    wanted |= {"N": numbers.N, "K": numbers.K}
    if text == "WN + RW":
        at = lowest(lambda sizes: truth.allan_variance(sizes, RATE), 2**13)
        wanted["B"] = math.sqrt(float(truth.allan_variance([at], RATE)[0])) / FLOOR
    covered = dict.fromkeys(wanted, 0)
    for x in truth.simulate(n, RATE, rng=20, paths=paths):
        found = gmwm.fit(text, x, rate=RATE, certify=False).datasheet(0.9)
        for symbol, value in wanted.items():
            covered[symbol] += found[symbol].low <= value <= found[symbol].high
    # Four standard errors of a share of 0.9, and 2 % for the chi-square of few degrees of freedom.
    room = 4 * math.sqrt(0.9 * 0.1 / paths) + 0.02
    assert {s: c / paths for s, c in covered.items() if abs(c / paths - 0.9) > room} == {}


# --- units and words ----------------------------------------------------------------------------------


def test_units_of_a_gyroscope_and_an_accelerometer():
    gyro, accel = (sheet_of(FULL.structure, exact(FULL, unit)) for unit in ("rad/s", "m/s²"))
    degree = math.pi / 180
    wanted = [
        ("N", "deg/√h", 60 / degree), ("N", "deg/s/√Hz", 1 / degree), ("B", "deg/h", 3600 / degree),
        ("K", "deg/h/√h", 3600 * 60 / degree), ("K", "rad/s²/√Hz", 1.0), ("R", "deg/h/h", 3600**2 / degree),
        ("Q", "arcsec", 3600 / degree), ("Q", "µrad", 1e6), ("q_c[1]", "deg/h/√h", 3600 * 60 / degree),
    ]  # fmt: skip
    for symbol, unit, factor in wanted:
        assert gyro[symbol].in_units(unit)[0] == near(factor * gyro[symbol].value)
    g = 9.80665
    wanted = [
        ("N", "m/s/√h", 60.0), ("N", "µg/√Hz", 1e6 / g), ("B", "mg", 1e3 / g), ("B", "m/s²", 1.0),
        ("K", "m/s²/√h", 60.0), ("K", "mg/√h", 60e3 / g), ("R", "mg/h", 3.6e6 / g), ("Q", "mm/s", 1e3),
    ]  # fmt: skip
    for symbol, unit, factor in wanted:
        assert accel[symbol].in_units(unit)[0] == near(factor * accel[symbol].value)
    assert gyro["N"].in_units("°/√h") == gyro["N"].in_units("datasheet")
    assert gyro["T_c[1]"].in_units("datasheet")[3] == "s"
    with raises(OptionError, "'si', 'datasheet' or one of deg/√h, deg/s/√Hz, rad/s/√Hz", argument="units", got="mg"):
        gyro["N"].in_units("mg")


def test_a_sensor_that_is_not_known():
    found = sheet_of("WN + RW", exact(WN(sigma2=1.0) + RW(gamma2=1e-4), unit="", axis=""))
    assert [row["unit"] for row in found.table("datasheet")] == ["u/√Hz", "u/√s", "u"]
    assert found.unit == "u"
    assert noise_unit(-1.0, "volt") == ("volt/s", 1.0)
    assert datasheet_units("volt/s") == {}


@pytest.mark.parametrize(
    ("numbers", "text"),
    [
        ((0.2113, 0.2012, 0.2215), "0.211 (0.201 … 0.222) u"),
        ((123.4, 120.0, 126.9), "123.4 (120.0 … 126.9) u"),
        ((5.0, 0.01, 2500.0), "5.0 (0.010 … 2500) u"),
        ((-3.0, -3.5, -2.5), "−3.00 (−3.50 … −2.50) u"),
        ((1.0e-7, 0.9e-7, 1.1e-7), "1.00e-07 (9.00e-08 … 1.10e-07) u"),
        ((0.0, -1.0, 1.0), "0 (−1.0 … 1.0) u"),
    ],
)
def test_as_many_digits_as_the_interval_deserves(numbers, text):
    value, low, high = numbers
    assert Entry(symbol="B", title="bias", value=value, low=low, high=high, unit="u").text() == text


def test_words():
    found = sheet_of("GM + WN + RW + DR", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6) + RW(gamma2=1e-12)))
    lines = found.summary().splitlines()
    assert lines[0] == "gyro_x: GM + WN + RW + DR, 262144 samples at 100 Hz, 95 % intervals"
    assert lines[1].startswith("  N ")
    assert "deg/√h" in lines[1]
    assert "deg/s/√Hz" in lines[1]
    assert "rad/s/√Hz" in found.summary("si")
    assert "white noise density" in found._repr_html_()
    assert repr(found).startswith("Datasheet(gyro_x: N = 0.40")
    rows = found.table("si")
    assert rows[0]["symbol"] == "N"
    assert rows[0]["value"] == found["N"].value
    np.testing.assert_allclose(
        found.allan_deviation**2, 2 * gmwm.fit("GM + WN + RW + DR", exact(GM(beta=0.5, sigma2=1e-8) + WN(sigma2=1e-6)
        + RW(gamma2=1e-12))).implied
    )  # fmt: skip
    fit = gmwm.fit("WN", Signal(np.random.default_rng(1).normal(size=500), RATE, "m/s²"))
    assert fit.datasheet()["N"].unit == "m/s²/√Hz"


@pytest.mark.parametrize("text", ["µg/√Hz", "ug/sqrt(Hz)", "µg/rtHz", "ug / √hz"])
def test_units_are_found_however_they_are_spelt(text):
    entry = Entry(symbol="N", title="white noise density", value=9.80665e-5, low=None, high=None, unit="m/s²/√Hz")
    value, _, _, name = entry.in_units(text)
    assert (round(value, 9), name) == (10.0, "µg/√Hz")
