"""Laws of every process under every wavelet filter."""

import math
from functools import cache
from itertools import islice

import numpy as np
import pytest

from gmwm.base.errors import MissingTheoryError
from gmwm.measuring.variance.transform import variances
from gmwm.theory.filters import FILTERS, HAAR, find_filter
from gmwm.theory.processes import AR1, DR, GM, RW, WN, Process, every_class
from tests.helpers import each, raises
from tests.oracles import filters as oracle

RATE = 250.0
CLASSES = every_class()
every_filter = each("name", FILTERS)
FAMILIES = ("haar", "d4", "la8", "fk8", "mb8", "bl14")
"""One filter of each family: a process knows of a filter its taps only."""
every_family = each("name", (*FAMILIES, "mb24"))
every_process = each("process", CLASSES.values())
curved = [p for p in CLASSES.values() if len(p.nonlinear_parameters()) == 1]
# Of a line the squared gain swings within a hundredth of its frequency; what it gives has mpmath to answer to.
smooth = [p for p in curved if p.line is Process.line]
DECAYS = (1e-12, 5e-6, 1e-3, 0.05, 0.7, 3.0, 20.0)


def rows(process, decays, signs=(1.0, -1.0)):
    """Nonlinear parameters that have these distances from the wandering end."""
    parameters = process.nonlinear_parameters()
    if not parameters:
        return np.empty((1, 0))
    if process.search(1000, RATE):
        by_domain = {"positive": lambda d, s: d * RATE, "between": lambda d, s: s * math.exp(-d)}
        made = [[by_domain[p.domain](d, s) for p in parameters] for d in decays for s in signs]
        return np.unique(np.array(made), axis=0)
    ends, golden = process.scan(1000, RATE), (math.sqrt(5) - 1) / 2
    shares = [(math.log(d) / 37 * (1 + 0.1 * s) + golden * np.arange(len(ends))) % 1.0 for d in decays for s in signs]
    return process.at_coordinates(ends[:, 0] + np.array(shares) * (ends[:, 1] - ends[:, 0]))


def examples(process):
    scale = process.value_from(0.7)
    names = [p.name for p in process.nonlinear_parameters()]
    for row in rows(process, (0.03, 0.5)):
        yield process(**dict(zip(names, map(float, row), strict=True)), **{process.scale_parameter().name: scale})


# --- accuracy -----------------------------------------------------------------------------------------


@every_process
def test_a_closed_form_has_hundred_digit_arithmetic_to_answer_to(process):
    if process.shape.__func__ is not Process.shape.__func__:
        assert process.name in oracle.SHAPES


@cache
def exact_taps(name):
    f = find_filter(name)
    return oracle.orthonormal(list(f.scaling), f.vanishing_moments)


@pytest.mark.slow
@pytest.mark.parametrize("filter_name", FAMILIES)
@pytest.mark.parametrize("name", oracle.SHAPES)
def test_shape_agrees_with_hundred_digits_down_to_level_thirty(name, filter_name):
    f, process = find_filter(filter_name), CLASSES[name]
    taps = exact_taps(filter_name)
    table = rows(process, DECAYS)[:: oracle.STRIDES.get(name, 1)]
    if filter_name != "haar":  # the others share the rows
        table = table[(FAMILIES.index(filter_name) - 1) % len(table) :: 5]
    shapes = process.shape(table, 30, RATE, f)
    exact = np.array([[float(v) for v in oracle.SHAPES[name](taps, list(row), RATE, 30)] for row in table])
    if process is DR and f.vanishing_moments > 1:
        assert not np.any(shapes)
        assert np.abs(exact).max() < 1e-40
    else:
        # A filter with two vanishing moments leaves next to nothing of a power law near α = 3.
        few = 1e-12 if name in oracle.STRIDES else 2e-13
        # Under other filters than Haar, an oscillator is the difference of its block sums, relative to its variance.
        rounding = 1e-13 if name == "OSC" and filter_name != "haar" else 0.0
        np.testing.assert_allclose(shapes, exact, rtol=few, atol=rounding)


@pytest.mark.slow
@each("process", smooth)
@every_family
def test_jacobian_agrees_with_differences(process, name):
    f, table = find_filter(name), rows(process, (1e-3, 0.03, 0.5, 4.0))
    given = process.shape_jacobian(table, 12, RATE, f)
    derived = Process.shape_jacobian.__func__(process, table, 12, RATE, f)
    size = process.shape(table, 12, RATE, f)[:, :, None] / np.abs(table)[:, None, :]
    assert np.all(np.abs(given - derived) <= 1e-8 * (size + np.abs(given)))


@pytest.mark.slow
@every_family
@every_process
def test_extremes_give_finite_shapes_and_no_warning(process, name):
    f = find_filter(name)
    extremes = {"positive": [1e-290, 1e290], "between": [0.0, 5e-324, 1 - 2.0**-53, 2.0**-53 - 1]}
    if process.search(1000, 1.0):
        tables = [np.array([[value]]) for value in extremes[process.nonlinear_parameters()[0].domain]]
    else:
        tables = [rows(process, (1e-9, 1e9))]
    for table in tables:
        with np.errstate(all="raise", under="ignore"):
            # A sum over an autocovariance, where that is all there is, does not reach so deep.
            deep = process._gives("wavelet_variance") or (process._gives("state_space") and not process.approximate)
            levels = 40 if deep else 8
            shape = process.shape(table, levels, 1.0, f)
            slope = process.shape_jacobian(table, levels, 1.0, f)
        unseen = process is DR and f.vanishing_moments > 1
        assert np.all(np.isfinite(shape))
        assert np.all(shape >= 0 if unseen else shape > 0)
        assert np.all(np.isfinite(slope))


# --- default = override = definition ------------------------------------------------------------------


@pytest.mark.slow
@every_family
@every_process
def test_shape_is_the_sum_over_the_filter(process, name):
    f = find_filter(name)
    for one in examples(process):
        for level in (1, 2, 4):
            r = f.autocorrelation(np.arange(1 - f.width(level), f.width(level)), level)
            lags = np.arange(1 - f.width(level), f.width(level))
            if process.has("autocovariance"):
                dense = r @ one.autocovariance(lags, RATE)
            elif process.has("running_sum_covariance"):
                k = one.running_sum_covariance(np.arange(lags[0] - 1, lags[-1] + 2), RATE)
                dense = r @ (2 * k[1:-1] - k[:-2] - k[2:])
            else:
                dense = (f.level_filter(level) @ one.mean(lags[lags >= 0])) ** 2
            # A filter may leave next to nothing of a line, and the sum its rounding.
            rounding = 1e-15 * one.scale if one.line(RATE) else 1e-18
            assert one.wavelet_variance([level], RATE, name)[0] == pytest.approx(dense, rel=1e-10, abs=rounding)


@pytest.mark.slow
@every_family
@every_process
def test_shape_given_agrees_with_the_default(process, name):
    if not process.has("running_sum_covariance"):
        with raises(MissingTheoryError, process.name, "d4", advises=("filter='haar'",)):
            Process.shape.__func__(process, rows(process, (0.5,)), 5, RATE, find_filter("d4"))
        return
    f, table = find_filter(name), rows(process, (0.01, 0.5))
    # Where the spectrum vanishes at f = 0 (quantization noise) the default loses digits from level to level.
    vanishes = process.stationary and process.has("psd") and _density_at_zero(process) == 0
    # A sum over all lags is for few levels.
    levels = 20 if process.stationary and not vanishes and process._derives("state_space") else 8
    derived = Process.shape.__func__(process, table, levels, RATE, f)
    rounding = 0.0 if process.line is Process.line else 1e-14
    np.testing.assert_allclose(derived, process.shape(table, levels, RATE, f), rtol=1e-9, atol=rounding)


def _density_at_zero(process):
    return next(examples(process)).psd([0.0], RATE)[0]


def test_state_space_default_is_accurate_where_the_state_hardly_moves():
    f, table = find_filter("la8"), np.array([[1e-6 * RATE], [1e-4 * RATE]])
    derived = Process.shape.__func__(GM, table, 25, RATE, f)
    # The transition itself, a double next to 1, holds λ to 1e-16/λ.
    np.testing.assert_allclose(derived, GM.shape(table, 25, RATE, f), rtol=1e-8)


def test_a_sum_too_long_is_refused_and_the_way_out_named():
    with raises(MissingTheoryError, "RW", "la8", method="shape", process="RW", advises=("filter='haar'",)):
        Process.shape.__func__(RW, np.empty((1, 0)), 24, RATE, find_filter("la8"))


@every_process
def test_haar_is_the_default_to_the_last_bit(process):
    for one in examples(process):
        for other in ("haar", HAAR):
            np.testing.assert_array_equal(one.wavelet_variance(20, RATE), one.wavelet_variance(20, RATE, other))


@every_process
def test_haar_by_another_name_agrees(process):
    pytest.importorskip("pywt")
    for one in examples(process):
        np.testing.assert_allclose(one.wavelet_variance(20, RATE), one.wavelet_variance(20, RATE, "db1"), rtol=1e-12)


@every_filter
def test_models_add_under_every_filter(name):
    model = GM(beta=1.0, sigma2=2.0) + WN(sigma2=1.0) + RW(gamma2=1e-3)
    parts = model.decomposition(9, RATE, name)
    np.testing.assert_allclose(sum(parts.values()), model.wavelet_variance(9, RATE, name), rtol=1e-14)
    jacobian = model.jacobian(9, RATE, name)
    np.testing.assert_allclose(jacobian[:, 1] * 2.0, parts["GM"], rtol=1e-14)
    np.testing.assert_allclose(jacobian[:, 3] * 1e-3, parts["RW"], rtol=1e-14)


# --- simulation ---------------------------------------------------------------------------------------

PATHS, SAMPLES = 40, 1200
STANDARD_ERRORS = 4.3
"""Exceeded by a mean of 40 paths in 1 of 9000 cases (Student's t), as 4 by a mean of 120."""


@pytest.mark.slow
@every_process
def test_estimates_of_simulated_paths_have_the_theory_for_their_mean(process):
    few = 1 if hasattr(process, "orders") else None
    for k, one in enumerate(islice(examples(process), few)):
        paths = one.simulate(SAMPLES, RATE, np.random.default_rng(40 + k), paths=PATHS)
        for name in FAMILIES:
            f = find_filter(name)
            levels = min(4, f.deepest_level(SAMPLES // 2))
            exact = one.wavelet_variance(levels, RATE, f)
            maximal, decimated = (
                np.array([variances(path, f, transform, levels) for path in paths]) for transform in ("modwt", "dwt")
            )
            # What a drift should not leave, and what it leaves of rounding.
            rounding = 1e-10 * exact + 1e-24 * float(np.mean(paths**2))
            for estimates in (maximal, decimated, maximal - decimated):
                error = estimates.std(axis=0, ddof=1) / math.sqrt(PATHS)
                wanted = 0.0 if estimates is not maximal and estimates is not decimated else exact
                assert np.all(np.abs(estimates.mean(axis=0) - wanted) <= STANDARD_ERRORS * error + rounding), name


def test_the_laws_above_run_over_both_signs_of_an_autoregression():
    assert sorted(np.sign(rows(AR1, (0.03, 0.5))[:, 0])) == [-1, -1, 1, 1]
