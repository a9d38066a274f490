"""The Haar kernel: laws of the wavelet variance, then its slow twins, then numbers of real recordings."""

import gc
import json
import threading
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gmwm.base import _core
from tests.oracles import haar as oracle

ROOT = Path(__file__).resolve().parents[2]
SHARED = ROOT.parent / "shared"

deterministic = settings(derandomize=True, deadline=None, max_examples=40)
extended = pytest.mark.skipif(not oracle.extended_precision, reason="long double is a double on this platform")
signals = hnp.arrays(np.float64, st.integers(2, 700), elements=st.integers(-(2**20), 2**20).map(float))


def top_level(x):
    return x.size.bit_length() - 1


def variance(x):
    return _core.haar_variance(x, top_level(x))[0]


def white(n, seed=0):
    return np.random.default_rng(seed).standard_normal(n)


# Laws


@pytest.mark.slow
@deterministic
@given(signals)
def test_integers_give_the_exact_rational(x):
    values = variance(x)
    for level in range(1, top_level(x) + 1):
        exact = oracle.exact_variance([int(v) for v in x], level)
        assert abs(Fraction(float(values[level - 1])) - exact) <= Fraction(1, 10**12) * exact


@pytest.mark.slow
@deterministic
@given(signals, st.integers(-40, 40))
def test_scaling_by_a_power_of_two_is_exact(x, power):
    np.testing.assert_array_equal(variance(np.ldexp(x, power)), np.ldexp(variance(x), 2 * power))


@pytest.mark.slow
@deterministic
@given(signals)
def test_sign_and_direction_of_time_do_not_matter(x):
    np.testing.assert_array_equal(variance(-x), variance(x))
    # To rounding of the level's own running sum: a nearly constant level has few digits to agree in.
    np.testing.assert_allclose(variance(x[::-1].copy()), variance(x), rtol=1e-12, atol=1e-20 * float(x @ x))


@deterministic
@given(st.integers(2, 3000), st.floats(-1e12, 1e12))
def test_a_constant_is_exactly_zero(n, value):
    assert not np.any(variance(np.full(n, value)))


@deterministic
@given(st.integers(8, 12_000), st.lists(st.floats(0, 1), max_size=6), st.integers(1, 13))
def test_ranges_of_t_add_up(n, cuts, levels):
    x = white(n)
    levels = min(levels, top_level(x))
    total = _core.running_sum(x)
    edges = sorted({0, n, *(int(c * n) for c in cuts)})
    parts = [_core.haar_sums_of_squares(total, levels, a, b) for a, b in pairwise(edges)]
    whole = _core.haar_sums_of_squares(total, levels, 0, n)
    np.testing.assert_allclose(np.sum(parts, axis=0), whole, rtol=1e-13)
    counts = n - 2 ** np.arange(1, levels + 1) + 1
    np.testing.assert_allclose(_core.haar_variance(x, levels)[0], whole / counts, rtol=1e-13)


def test_fewer_levels_are_the_first_of_many():
    x = white(5000)
    np.testing.assert_allclose(_core.haar_variance(x, 5)[0], variance(x)[:5], rtol=1e-13)


# Slow twins


@extended
@pytest.mark.parametrize("n", [2, 3, 8, 1000, 4095, 4096, 4097, 10_007, 2**14])
@pytest.mark.parametrize("kind", ["white", "offset", "walk", "drift"])
def test_definition_in_extended_precision(kind, n):
    e = white(n)
    x = {"white": e, "offset": e + 9810.0, "walk": np.cumsum(e), "drift": e + 1e-3 * np.arange(n)}[kind]
    np.testing.assert_allclose(variance(x), oracle.variance(x, top_level(x)).astype(float), rtol=1e-12)


@extended
def test_running_sum_stays_within_a_few_units_in_the_last_place():
    x = white(100_003) + 9810.0
    exact = np.cumsum(x.astype(np.longdouble) - np.longdouble(_core.mean(x)))
    total = _core.running_sum(x)
    assert total[0] == 0.0
    spacing = np.spacing(float(np.max(np.abs(exact))))
    assert np.max(np.abs(total[1:] - exact)) <= 100 * float(spacing)


@extended
@pytest.mark.parametrize(
    ("begin", "end"), [(0, 0), (0, 1), (1, 2), (3, 4097), (4095, 4096), (5000, 9999), (31, 10_007)]
)
def test_sums_of_squares_of_a_range(begin, end):
    x = white(10_007)
    sums = _core.haar_sums_of_squares(_core.running_sum(x), 13, begin, end)
    expected = oracle.sums_of_squares(x, 13, begin, end).astype(float)
    np.testing.assert_allclose(sums, expected, rtol=1e-12)
    assert np.all((expected == 0) == (end < 2 ** np.arange(1, 14)))


@pytest.mark.parametrize("axis", ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"])
def test_adis16405(axis):
    data, reference = SHARED / "data/adis16405_static_1.parquet", SHARED / "reference/haar_wv_adis16405_static_1.json"
    if not (data.exists() and reference.exists()):
        pytest.skip("needs the ADIS 16405 recording of ../shared")
    import polars

    x = polars.read_parquet(data, columns=[axis])[axis].to_numpy()
    expected = json.loads(reference.read_text())[axis]["classical"]
    np.testing.assert_allclose(_core.haar_variance(np.ascontiguousarray(x), len(expected))[0], expected, rtol=1e-10)


# The door


@pytest.mark.parametrize("at", [0, 100, 511])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_values_that_are_not_finite_show_everywhere(bad, at):
    x = white(512)
    x[at] = bad
    assert np.isnan(_core.mean(x))
    assert np.all(np.isnan(_core.haar_variance(x, 9)[0]))
    assert np.all(np.isnan(_core.running_sum(x)[1:]))


def test_a_sum_that_overflows_is_not_taken_for_infinite_data():
    assert _core.mean(np.array([1.5e308, -1.5e308, 1.5e308, -1.5e308])) == 0.0
    assert _core.mean(np.full(7, 1.5e308)) == 1.5e308


@pytest.mark.parametrize(
    "x",
    [[1.0, 2.0], np.arange(8), np.arange(8, dtype=np.float32), np.arange(16.0)[::2], np.ones((4, 4)), None],
    ids=["list", "int64", "float32", "strided", "two-dimensional", "None"],
)
def test_only_contiguous_doubles_are_taken(x):
    for call in (_core.mean, _core.running_sum, lambda v: _core.haar_variance(v, 1)):
        with pytest.raises(TypeError):
            call(x)


@pytest.mark.parametrize("levels", [0, 4, 63, 64, 65, 2**40])
def test_levels_that_do_not_exist(levels):
    with pytest.raises(ValueError, match=r"^levels "):
        _core.haar_variance(white(15), levels)
    with pytest.raises(ValueError, match=r"^levels "):
        _core.haar_sums_of_squares(_core.running_sum(white(15)), levels, 0, 15)


@pytest.mark.parametrize(("begin", "end"), [(3, 2), (0, 16), (16, 16), (2**63, 2**63)])
def test_ranges_that_do_not_exist(begin, end):
    with pytest.raises(ValueError, match=r"^begin and end "):
        _core.haar_sums_of_squares(_core.running_sum(white(15)), 3, begin, end)


def test_empty_arrays():
    for call in (_core.mean, _core.running_sum):
        with pytest.raises(ValueError, match="empty"):
            call(np.empty(0))
    with pytest.raises(ValueError, match="2"):
        _core.haar_sums_of_squares(np.zeros(1), 1, 0, 0)


def test_read_only_input_is_read_and_left_alone():
    x = white(1000)
    kept = x.copy()
    x.flags.writeable = False
    variance(x)
    np.testing.assert_array_equal(x, kept)


@pytest.mark.slow
def test_results_own_their_memory():
    results = [_core.running_sum(white(1000, seed)) for seed in range(20)]
    expected = [r.copy() for r in results]
    gc.collect()
    junk = [_core.running_sum(white(1000, 99)) for _ in range(20)]
    for result, kept in zip(results, expected, strict=True):
        np.testing.assert_array_equal(result, kept)
    assert len(junk) == 20


def test_clone_is_one_that_we_know():
    name = _core.clone()
    print(f"the kernels run as {name}")
    assert name in {"x86-64-v4", "x86-64-v3", "default", "portable"}


def test_threads_share_one_running_sum():
    n, levels = 200_000, 17
    total = _core.running_sum(white(n))
    edges = [0, n // 3, 2 * n // 3, n]
    parts = [np.zeros(levels)] * 3

    def part(k):
        parts[k] = _core.haar_sums_of_squares(total, levels, edges[k], edges[k + 1])

    threads = [threading.Thread(target=part, args=(k,)) for k in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    np.testing.assert_allclose(sum(parts), _core.haar_sums_of_squares(total, levels, 0, n), rtol=1e-13)


def test_an_inbox_accepts_small_arrays_of_finite_doubles_only():
    buffer = np.zeros(10)
    inbox = _core.Inbox(buffer)
    assert inbox.append(np.array([1.0, 2.0]), 4)
    bytes_between = np.frombuffer(b"0" * 17, dtype=np.float64, count=2, offset=1)
    for chunk in (
        [3.0], 3.0, None, np.array(3.0), np.ones((1, 1)), np.array([3]), np.array([3.0], dtype=np.float32),
        np.ma.array([3.0], mask=[True]), np.array([np.nan]), np.array([1.0, np.inf]), np.array([1e308, 1e308]),
        np.empty(0), np.ones(5), np.ones(4)[::2], bytes_between,
    ):  # fmt: skip
        assert not inbox.append(chunk, 4), chunk
    assert inbox.used == 2
    assert inbox.append(np.arange(4.0), 4)
    assert inbox.append(np.arange(4.0), 4)
    assert not inbox.append(np.ones(1), 4)
    assert buffer.tolist() == [1.0, 2.0, 0.0, 1.0, 2.0, 3.0, 0.0, 1.0, 2.0, 3.0]


@pytest.mark.parametrize("n", [5000, 300_001])
def test_the_rise_is_the_difference_of_the_means_of_both_halves(n):
    x = 9810.0 + np.cumsum(white(n))
    half = n // 2
    expected = (x[half:].mean() - x[:half].mean()) / (n / 2)
    assert _core.haar_variance(x, 5)[1] == pytest.approx(expected, rel=1e-10)
