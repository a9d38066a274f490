"""Laws that every process in the registry obeys; a new process is under them by being registered."""

import ast
import inspect
import math
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import toeplitz

from gmwm.base.errors import MissingTheoryError, OptionError
from gmwm.theory.processes import Process, every_class, ordered_classes, registry
from gmwm.theory.processes.exponential_sum import lag_sums
from tests.helpers import each, raises
from tests.oracles import processes as oracle

fixed_profile = settings(derandomize=True, deadline=None, max_examples=25, database=None)

CLASSES = every_class()
every_process = pytest.mark.parametrize("process", CLASSES.values(), ids=CLASSES.keys())
loop_over_process = each("process", CLASSES.values())
curved = [p for p in CLASSES.values() if p.nonlinear_parameters()]
every_curved = pytest.mark.parametrize("process", curved, ids=[p.name for p in curved])
searched = [p for p in curved if p.search(1000, 1.0)]
every_searched = pytest.mark.parametrize("process", searched, ids=[p.name for p in searched])
RATE = 250.0


def every_process_having(theory):
    having = [p for p in CLASSES.values() if p.has(theory)]
    return pytest.mark.parametrize("process", having, ids=[p.name for p in having])


with_exact_states = [p for p in CLASSES.values() if p._derives("state_space")]
every_process_with_exact_states = pytest.mark.parametrize(
    "process", with_exact_states, ids=[p.name for p in with_exact_states]
)
LEVELS = np.arange(1, 11)
GOLDEN = (math.sqrt(5) - 1) / 2


def draw(process: type[Process], decay: float, sign: float, scale: float) -> Process:
    """An instance whose nonlinear parameters have the given distance from the wandering end.

    A process without a search has its parameters all over its scan instead, each elsewhere.
    """
    names = [p.name for p in process.nonlinear_parameters()]
    if process.search(1000, RATE):
        by_domain = {"positive": decay * RATE, "between": sign * math.exp(-decay)}
        values = [by_domain[p.domain] for p in process.nonlinear_parameters()]
    else:
        ends = process.scan(1000, RATE)
        share = (math.log(decay) / 37 * (1 + 0.1 * sign) + GOLDEN * np.arange(len(ends))) % 1.0
        values = process.at_coordinates((ends[:, 0] + share * (ends[:, 1] - ends[:, 0])).reshape(1, -1))[0]
    nonlinear = dict(zip(names, map(float, values), strict=True))
    return process(**nonlinear, **{process.scale_parameter().name: process.value_from(scale)})


def instances(process, slowest=1e-6, fastest=20.0):
    decay = st.floats(math.log(slowest), math.log(fastest)).map(math.exp)
    scale = st.floats(-12, 12).map(lambda e: 10.0**e)
    return st.builds(lambda d, s, c: draw(process, d, s, c), decay, st.sampled_from([1.0, -1.0]), scale)


def examples(process, count=6, **limits):
    """A few fixed instances for laws that are too slow for hypothesis, from slow to fast."""
    slow, fast = limits.get("slowest", 1e-3), limits.get("fastest", 5.0)
    decays = np.geomspace(slow, fast, count) if process.nonlinear_parameters() else [1.0]
    return [draw(process, float(d), (-1.0) ** k, 0.7) for k, d in enumerate(decays)]


def nonlinear_grid(process):
    decays = np.concatenate([np.geomspace(1e-12, 50.0, 45), [0.499, 0.5, 0.999, 1.0, 1.001, 2.0]])
    if not process.nonlinear_parameters():
        return np.empty((1, 0))
    decays = [d for d in decays if process.parameters[0].domain != "between" or math.exp(-d) < 1]
    rows = [draw(process, float(d), s, 1.0).nonlinear for d in decays for s in (1.0, -1.0)]
    return np.unique(rows, axis=0)


# --- accuracy -----------------------------------------------------------------------------------------


@loop_over_process
def test_a_shape_in_closed_form_has_fifty_digit_arithmetic_to_answer_to(process):
    if process.shape.__func__ is not Process.shape.__func__:
        assert process.name in oracle.SHAPES


@pytest.mark.slow
@pytest.mark.parametrize("name", oracle.SHAPES)
def test_shape_agrees_with_fifty_digits(name):
    process, levels = CLASSES[name], [1, 2, 3, 5, 9, 14, 20, 25, 30]
    rows = nonlinear_grid(process)
    shapes = process.shape(rows, levels, RATE)
    exact = np.array([[float(oracle.shape(name, list(row), RATE, j)) for j in levels] for row in rows])
    # An oscillation turns many times in a scale, so its phase is known less well.
    np.testing.assert_allclose(shapes, exact, rtol=3e-14 if name == "OSC" else 3e-15)


@pytest.mark.slow
@pytest.mark.parametrize("name", [p.name for p in curved if p.name in oracle.SHAPES and p.name != "OSC"])
def test_jacobian_agrees_with_fifty_digits(name):
    """The derivatives of an oscillation are differences, which do not resolve scales of many periods."""
    process, levels = CLASSES[name], [1, 2, 3, 5, 9, 14, 20, 25, 30]
    rows = nonlinear_grid(process)[:: 2 if len(process.nonlinear_parameters()) == 1 else 12]
    slopes = process.shape_jacobian(rows, levels, RATE)
    for by in range(slopes.shape[2]):
        exact = [[float(oracle.slope(name, list(row), RATE, j, by)) for j in levels] for row in rows]
        # The oracle says 1e-120 where a derivative is 0.
        np.testing.assert_allclose(slopes[:, :, by], exact, rtol=1e-12, atol=1e-90)


def deepest(process, level):
    """The level, or one that the sum over an autocovariance reaches, where that is all there is."""
    theory = ("wavelet_variance", "state_space", "running_sum_covariance")
    return level if any(process._gives(name) and process._derives(name) for name in theory) else min(level, 12)


@pytest.mark.slow
@loop_over_process
def test_shape_takes_many_rows_at_once_and_raises_no_warning_at_the_extremes(process):
    rows = np.repeat(nonlinear_grid(process), 2, axis=0)
    with np.errstate(all="raise", under="ignore"):
        shapes = process.shape(rows, levels := deepest(process, 62), RATE)
        slopes = process.shape_jacobian(rows, levels, RATE)
    assert shapes.shape == (len(rows), levels)
    assert slopes.shape == (len(rows), levels, rows.shape[1])
    assert np.all(np.isfinite(shapes))
    assert np.all(shapes > 0)
    assert np.all(np.isfinite(slopes))
    np.testing.assert_array_equal(shapes[::2], shapes[1::2])


@every_searched
def test_extreme_but_legal_values_give_finite_positive_shapes(process):
    extremes = {"positive": [1e-290, 1e290], "between": [0.0, -0.0, 5e-324, 1 - 2.0**-53, -1 + 2.0**-53]}
    for value in extremes[process.nonlinear_parameters()[0].domain]:
        with np.errstate(all="raise", under="ignore"):
            shape = process.shape(np.array([[value]]), 40, 1.0)
            slope = process.shape_jacobian(np.array([[value]]), 40, 1.0)
        assert np.all((shape > 0) & np.isfinite(shape))
        assert np.all(np.isfinite(slope))


# --- default = override -------------------------------------------------------------------------------


@every_process_having("running_sum_covariance")
def test_wavelet_variance_follows_from_the_running_sum(process):
    h = 2 ** (LEVELS - 1)
    for one in examples(process):
        k0, k1, k2 = (one.running_sum_covariance(m, RATE) for m in (np.zeros(1, int), h, 2 * h))
        derived = (6 * k0 - 8 * k1 + 2 * k2) / (4.0 * h**2)
        # What cancels is the size of the terms, so that is what the rounding is measured against; of a process that
        # has a state space alone each of them is a sum of many.
        size = (np.abs(6 * k0) + np.abs(8 * k1) + np.abs(2 * k2)) / (4.0 * h**2)
        assert np.all(np.abs(derived - one.wavelet_variance(LEVELS, RATE)) <= 5e-14 * size)


@every_process_with_exact_states
def test_wavelet_variance_follows_from_the_state_space(process):
    for one in examples(process, slowest=1e-6):
        derived = one.state_space(RATE).haar_variance(20)
        np.testing.assert_allclose(derived, one.wavelet_variance(20, RATE), rtol=1e-9)


@every_process_with_exact_states
def test_steps_of_the_continuous_form_are_the_state_space(process):
    for one in examples(process, slowest=1e-9, fastest=20.0):
        space, found = one.state_space(RATE), one.continuous(RATE)
        if found is None:
            # Only what turns over within a step, forgets, or has its noise in one state of several has none.
            turning = np.any(np.linalg.eigvals(space.F).real <= 0)
            assert turning or np.linalg.matrix_rank(space.Q) < space.states
            continue
        steps = found.discrete(RATE)
        for name in ("F", "Q", "H", "R", "m0", "P0"):
            wanted = getattr(space, name)
            size = np.max(np.abs(wanted), initial=0.0)
            np.testing.assert_allclose(getattr(steps, name), wanted, rtol=1e-12, atol=1e-14 * size)


@pytest.mark.slow
@every_process_having("autocovariance")
def test_wavelet_variance_follows_from_the_autocovariance(process):
    for one in examples(process):
        n = 2 ** int(LEVELS[-1])
        matrix = toeplitz(one.autocovariance(np.arange(n), RATE))
        for level in LEVELS[::3]:
            filter_ = np.repeat([1.0, -1.0], 2 ** (level - 1)) / 2**level
            part = matrix[: filter_.size, : filter_.size]
            assert filter_ @ part @ filter_ == pytest.approx(one.wavelet_variance([level], RATE)[0], rel=1e-9)


@pytest.mark.slow
@every_process_having("psd")
def test_wavelet_variance_follows_from_the_spectrum(process):
    for one in examples(process, slowest=1e-2):
        f, weight = _frequencies(one)
        density = one.psd(f * RATE, RATE)
        for level, variance in enumerate(one.wavelet_variance(8, RATE), start=1):
            h = 2 ** (level - 1)
            gain = np.sin(np.pi * h * f) ** 4 / (h * np.sin(np.pi * f)) ** 2
            octaves = RATE * np.sum(weight * gain * density, axis=1)
            rest = 0.0
            if len(octaves) > 1:
                # What is left has the ratio of the last two octaves.
                ratio = octaves[-1] / octaves[-2]
                rest = octaves[-1] * ratio / (1 - ratio)
            assert np.sum(octaves) + rest == pytest.approx(variance, rel=1e-9)


def _frequencies(process):
    """Nodes and weights over ±½, those of an octave in a row where a power of f may stand at f = 0."""
    if process._derives("state_space"):
        # The midpoint rule converges like φ^n for a periodic integrand, and is exact for a random walk.
        memory = process.correlation_time(RATE) or 0.0
        n = 2 ** max(16, math.ceil(math.log2(1 + 30 * memory * RATE)) if math.isfinite(memory) else 0)
        return ((np.arange(n) + 0.5) / n - 0.5).reshape(1, -1), np.full((1, n), 1 / n)
    nodes, weights = np.polynomial.legendre.leggauss(200)
    top = np.ldexp(0.5, -np.arange(45))[:, None]
    return top * (3 + nodes) / 4, top * weights / 2


@every_process_having("autocovariance")
@pytest.mark.parametrize("theory", ["running_sum_covariance", "autocovariance", "psd"])
def test_theory_given_agrees_with_theory_derived(process, theory):
    if not process.has(theory) or (theory != "running_sum_covariance" and not process._derives("state_space")):
        pytest.skip("there is no such theory, or nothing to derive it from")
    argument = np.linspace(-0.5, 0.5, 41) * RATE if theory == "psd" else np.arange(-40, 41)
    for one in examples(process):
        given_, derived = getattr(one, theory)(argument, RATE), getattr(Process, theory)(one, argument, RATE)
        if theory == "running_sum_covariance":  # defined up to a constant
            given_, derived = given_ - given_[40], derived - derived[40]
        np.testing.assert_allclose(given_, derived, rtol=1e-10, atol=1e-12 * np.abs(given_).max())


@every_curved
def test_jacobian_given_agrees_with_differences(process):
    if process.line is not Process.line:
        pytest.skip("its squared gain swings within a hundredth of the frequency; see the fifty digits")
    rows = np.array([one.nonlinear for one in examples(process)])
    given_ = process.shape_jacobian(rows, LEVELS, RATE)
    derived = Process.shape_jacobian.__func__(process, rows, LEVELS, RATE)
    size = process.shape(rows, LEVELS, RATE)[:, :, None] / np.abs(rows)[:, None, :]
    assert np.all(np.abs(given_ - derived) <= 1e-8 * (size + np.abs(given_)))


@loop_over_process
def test_shape_given_agrees_with_the_default(process):
    rows = np.array([one.nonlinear for one in examples(process, slowest=1e-2)])
    derived = Process.shape.__func__(process, rows, LEVELS, RATE)
    np.testing.assert_allclose(derived, process.shape(rows, LEVELS, RATE), rtol=1e-9)


@every_process_having("coefficient_covariance")
def test_sums_of_exponentials_have_the_variances_of_the_shape(process):
    # The sum over lags for a single coefficient is its variance.
    levels = np.arange(1, 9)
    for example in examples(process):
        terms = example.exponential_sum(RATE)
        if terms is None:
            terms = example.exponential_mixture(RATE, 2**8)
        if terms is None or example.scale == 0:
            continue
        expected = (
            example.wavelet_variance(8, RATE) - np.square(example.mean(1.0) - example.mean(0.0)) * 4.0**levels / 16
        )
        found = [lag_sums(levels[[k]], 2 ** (k + 1), terms, diagonal=True)[0][0] / 4.0 ** (k + 1) for k in range(8)]
        np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max())


# --- scale, simulation --------------------------------------------------------------------------------


@pytest.mark.slow
@every_process
@fixed_profile
@given(data=st.data(), power=st.integers(-40, 40))
def test_scaling_the_signal_scales_the_wavelet_variance_exactly(process, data, power):
    one = data.draw(instances(process))
    s, parameter = 2.0**power, process.scale_parameter()
    factor = s ** (2 // parameter.scale_power)
    scaled = one.with_values(**{parameter.name: one.value(parameter.name) * factor})
    np.testing.assert_array_equal(scaled.wavelet_variance(20, RATE), s**2 * one.wavelet_variance(20, RATE))
    assert scaled.scale == s**2 * one.scale


@pytest.mark.slow
@every_process
@fixed_profile
@given(data=st.data())
def test_scale_and_value_are_inverse(process, data):
    one = data.draw(instances(process))
    value = abs(one.value(process.scale_parameter().name))
    assert process.value_from(process.scale_from(value)) == pytest.approx(value, rel=1e-15)


def mean_square_of_haar(paths, levels):
    """Mean over t of W² (paths, J), by the definition of the coefficients."""
    sums = np.concatenate([np.zeros((len(paths), 1)), np.cumsum(paths, axis=1)], axis=1)
    result = []
    for level in range(1, levels + 1):
        h = 2 ** (level - 1)
        w = (sums[:, 2 * h :] - 2 * sums[:, h:-h] + sums[:, : -2 * h]) / 2**level
        result.append(np.mean(w**2, axis=1))
    return np.column_stack(result)


@pytest.mark.slow
@every_process
@pytest.mark.parametrize("how", ["given", "default"])
def test_simulated_paths_have_the_wavelet_variance(process, how):
    if how == "default" and not process._derives("state_space"):
        pytest.skip("there is no default without a state space")
    simulate = process.simulate if how == "given" else Process.simulate
    for k, one in enumerate(examples(process, count=4, slowest=1e-2, fastest=1.0)):
        paths = simulate(one, 512, RATE, np.random.default_rng(7 + k), paths=300)
        estimates = mean_square_of_haar(paths, 7)
        error = estimates.std(axis=0, ddof=1) / math.sqrt(len(paths))
        exact = one.wavelet_variance(7, RATE)
        # A drift has no spread at all: then the agreement is to rounding.
        assert np.all(np.abs(estimates.mean(axis=0) - exact) <= 4 * error + 1e-12 * exact)


@pytest.mark.slow
@loop_over_process
def test_simulation_starts_stationary_and_is_reproducible(process):
    for one in examples(process, count=3, slowest=1e-4):
        paths = one.simulate(3, RATE, 11, paths=4000)
        np.testing.assert_array_equal(paths, one.simulate(3, RATE, np.random.default_rng(11), paths=4000))
        assert one.simulate(3, RATE, 11).shape == (3,)
        if process.has("autocovariance"):
            variance = one.autocovariance([0], RATE)[0]
            error = np.sqrt((np.mean(paths**4, axis=0) - np.mean(paths**2, axis=0) ** 2) / len(paths))
            assert np.all(np.abs(np.mean(paths**2, axis=0) - variance) <= 4 * error)


@loop_over_process
def test_bad_arguments_are_named(process):
    one = examples(process, count=1)[0]
    for arguments, name in [
        ((0, RATE, 1), "n"),
        ((5, -1.0, 1), "rate"),
        ((5, RATE, None), "rng"),
        ((5, RATE, 1, 0), "paths"),
    ]:
        with raises(OptionError, argument=name):
            one.simulate(*arguments)
    with raises(OptionError, argument="rate", got=0.0):
        one.wavelet_variance(3, 0.0)


# --- what a process says about itself -----------------------------------------------------------------


@loop_over_process
def test_a_process_has_the_theory_it_declares(process):
    one = examples(process, count=1)[0]
    if "alpha" in one.values:  # power-law noise has a state space for exponents from 0 to 2 only
        one = one.with_values(alpha=1.2)
    calls = {
        "wavelet_variance": lambda: one.wavelet_variance(3, RATE),
        "running_sum_covariance": lambda: one.running_sum_covariance([0, 1, 2], RATE),
        "autocovariance": lambda: one.autocovariance([0, 1, 2], RATE),
        "psd": lambda: one.psd([1.0, 2.0], RATE),
        "simulate": lambda: one.simulate(3, RATE, 1),
        "state_space": lambda: one.state_space(RATE).H,
        "generalised_covariance": lambda: one.generalised_covariance([0, 1, 2], RATE),
    }
    for theory, call in calls.items():
        if process.has(theory):
            assert np.all(np.isfinite(call()))
        else:
            with raises(MissingTheoryError, process=process.name, theory=theory, advises=("wavelet_variance",)):
                call()
    with raises(OptionError, argument="theory", got="magic"):
        process.has("magic")


@loop_over_process
def test_declared_parameters_are_the_fields(process):
    assert [p.name for p in process.parameters] == [f.name for f in fields(process)]
    assert process.__doc__
    assert process.title
    assert process().values == dict.fromkeys([p.name for p in process.parameters])


@pytest.mark.slow
def test_each_name_is_written_once_on_the_model_side():
    """The name in its own class is the only place in code that knows the process."""
    sources = Path(inspect.getfile(Process)).parent.glob("*.py")
    # The package exports the classes by name.
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in sources if path.name != "__init__.py"]
    constants = [node.value for tree in trees for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    names = [*registry, *ordered_classes]
    assert {name: constants.count(name) for name in names} == dict.fromkeys(names, 1)


@every_searched
def test_search_branches_run_along_the_parameter(process):
    samples = 100_000
    for branch in process.search(samples, RATE):
        u = np.linspace(branch.low, branch.high, 9)
        values, step = branch.values(u), 1e-4
        assert values.shape == branch.slope(u).shape == (9, 1)
        # Near |φ| = 1 the float itself holds λ only to 1e-16/λ.
        back = [branch.coordinate(float(v)) for v in values[:, 0]]
        np.testing.assert_allclose(back, u, atol=1e-8)
        difference = (branch.values(u + step) - branch.values(u - step)) / (2 * step)
        np.testing.assert_allclose(branch.slope(u), difference, rtol=1e-5, atol=1e-11)
        for end, name in ((branch.low, branch.low_acts_as), (branch.high, branch.high_acts_as)):
            if name is not None:
                levels = int(math.log2(samples))
                here = process.shape(branch.values(np.array([end])), levels, RATE)[0]
                there = registry[name].shape(np.empty((1, 0)), levels, RATE)[0]
                np.testing.assert_allclose(here / here[-1], there / there[-1], rtol=0.01)


@every_curved
def test_coordinates_and_values_are_inverse_and_the_way_to_values_is_analytic(process):
    ends = process.scan(100_000, RATE)
    assert ends.shape == (len(process.nonlinear_parameters()), 2)
    assert np.all(ends[:, 0] < ends[:, 1])
    rng = np.random.default_rng(5)
    z = ends[:, 0] + rng.random((40, len(ends))) * (ends[:, 1] - ends[:, 0])
    values = process.at_coordinates(z)
    np.testing.assert_allclose(process.coordinates(values), z, rtol=1e-9, atol=1e-9)
    assert np.all(process.room(values) > 0)
    for row in values:
        assert process.standard(row).is_complete
    for k in range(len(ends)):
        step = np.zeros(len(ends))
        step[k] = 1e-4
        difference = (process.at_coordinates(z + step) - process.at_coordinates(z - step)) / 2e-4
        slope = np.imag(process.at_coordinates(z + 1e-30j * (step > 0))) / 1e-30
        np.testing.assert_allclose(slope, difference, rtol=1e-5, atol=1e-6 * np.abs(slope).max())


@every_searched
def test_every_value_lies_on_exactly_one_branch(process):
    for one in examples(process, slowest=1e-12, fastest=50.0):
        on = [b.coordinate(one.nonlinear[0]) for b in process.search(1000, RATE)]
        assert sum(u is not None for u in on) == 1


@every_searched
def test_correlation_time_is_that_of_the_autocovariance(process):
    for one in examples(process, slowest=1e-3, fastest=0.5):
        time = one.correlation_time(RATE)
        if time and math.isfinite(time):
            k = round(time * RATE)
            r0, rk = np.abs(one.autocovariance([0, k], RATE))
            assert rk / r0 == pytest.approx(math.exp(-k / (time * RATE)))
