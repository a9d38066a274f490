"""Sketches of |W|: whole numbers that add up however they are cut; then how near the robust variance comes."""

import math
import pickle
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

import gmwm
from gmwm.base import _core
from gmwm.measuring.variance.coefficients import HaarCoefficients, PlainCoefficients, PooledCoefficients
from gmwm.measuring.variance.robust import robust_variance, robust_variances
from gmwm.measuring.variance.sketch import BEYOND, BINS_OF_OCTAVE, Sketch, SketchCoefficients, Sketches
from tests.helpers import each, raises

deterministic = settings(derandomize=True, deadline=None, max_examples=25)
seeds = st.integers(0, 2**31)


def rng(seed=0):
    return np.random.default_rng(seed)


def white(n, seed=0):
    return rng(seed).standard_normal(n)


def same(a, b):
    np.testing.assert_array_equal(a.to_array(), b.to_array())
    return True


def sketched(w, efficiency=0.6, resolution=0.0):
    return float(robust_variances(SketchCoefficients([Sketch.of(w)], [resolution]), efficiency).variance[0])


# --- laws -------------------------------------------------------------------------------------------


def mixed(n, seed):
    """Of every size from subnormal to infinite, many of them zero, many the same."""
    w = white(n, seed) * 2.0 ** rng(seed + 1).integers(-1080, 1000, n)
    w[:: rng(seed).integers(2, 9)] = 0.0
    w[1 :: rng(seed).integers(2, 9)] = 0.75
    w[rng(seed + 2).integers(0, n, 3)] = [np.inf, -np.inf, np.nan]
    return w


@pytest.mark.slow
@deterministic
@given(seeds, st.lists(st.integers(0, 2000), max_size=6))
def test_any_cut_order_and_grouping_adds_up_to_all_at_once(seed, cuts):
    w = mixed(2000, seed)
    parts = [Sketch.of(part) for part in np.split(w, sorted(cuts))]
    rng(seed).shuffle(parts)
    while len(parts) > 1:
        k = int(rng(seed + len(parts)).integers(len(parts) - 1))
        parts[k : k + 2] = [parts[k].merge(parts[k + 1])]
    assert same(parts[0], Sketch.of(w))
    assert len(parts[0]) == 2000


def test_merging_leaves_both_as_they_were():
    a, b = Sketch.of(white(100)), Sketch.of(1e9 * white(100, 1))
    before = a.to_array(), b.to_array()
    a.merge(b)
    Sketch().merge(a).merge(Sketch())
    np.testing.assert_array_equal(a.to_array(), before[0])
    np.testing.assert_array_equal(b.to_array(), before[1])


@pytest.mark.slow
@deterministic
@given(seeds)
def test_stored_and_restored(seed):
    for sketch in (Sketch.of(mixed(500, seed)), Sketch.of(white(500, seed)), Sketch(), Sketch.of(np.zeros(3))):
        again = Sketch.from_array(sketch.to_array())
        assert same(again, sketch)
        assert same(Sketch.from_array(sketch.to_array().tolist()), sketch)
        assert same(pickle.loads(pickle.dumps(sketch)), sketch)
        assert same(again.merge(sketch), sketch.merge(sketch))


@pytest.mark.parametrize("power", [-900, -40, 3, 900])
def test_scaling_by_a_power_of_two_moves_octaves_and_nothing_else(power):
    w = white(5000)
    rows, moved = Sketch.of(w).to_array(), Sketch.of(np.ldexp(w, power)).to_array()
    np.testing.assert_array_equal(moved, rows + np.array([BINS_OF_OCTAVE * power, 0, 0]))
    if abs(power) < 100:
        assert sketched(np.ldexp(w, power)) == math.ldexp(sketched(w), 2 * power)


@deterministic
@given(seeds, st.integers(1, 10), st.integers(0, 3000), st.integers(0, 3000))
def test_haar_is_the_sketch_of_its_coefficients(seed, level, one, other):
    begin, end = sorted((one, other))
    total = _core.running_sum(white(3000, seed))
    h = 1 << (level - 1)
    w = np.ldexp(total[2 * h :] - 2 * total[h:-h] + total[: -2 * h], -level)
    first = 2 * h - 1
    part = w[max(begin - first, 0) : max(end - first, 0)]
    found = Sketch.of_haar(total, level, begin, end)
    assert len(found) == part.size
    # The order of the additions may differ in a last digit; the sum of a bin then in a unit, its count at an edge.
    assert abs(found.to_array()[:, 1].sum() - part.size) == 0
    cut = Sketch.of_haar(total, level, begin, (begin + end) // 2)
    assert same(cut.merge(Sketch.of_haar(total, level, (begin + end) // 2, end)), found)
    bins, counts, sums = found.to_array().T
    mean = (
        np.sum(
            (bins % BINS_OF_OCTAVE + BINS_OF_OCTAVE + sums / counts / 2**24)
            * 2.0 ** (bins // BINS_OF_OCTAVE - 1023)
            * counts
        )
        / BINS_OF_OCTAVE
    )
    assert mean == pytest.approx(np.abs(part).sum(), rel=1e-8, abs=0)


def test_a_level_that_no_samples_reach_is_empty():
    total = _core.running_sum(white(100))
    assert len(Sketch.of_haar(total, 7, 0, 100)) == 0
    assert len(Sketch.of_haar(total, 6, 0, 63)) == 0
    assert len(Sketch.of_haar(total, 6, 0, 64)) == 1


def test_edges_of_double_precision():
    tiny = 5e-324
    w = [0.0, -0.0, tiny, 2.0**-1030, 2.0**-1029, 2.0**-1022, 1.0, -1.0, 1.7976931348623157e308, math.inf, math.nan]
    rows = Sketch.of(w).to_array()
    assert rows.tolist()[0] == [0, 4, 0]
    assert rows.tolist()[1:5] == [
        [1, 1, 0],
        [BINS_OF_OCTAVE, 1, 0],
        [1023 * BINS_OF_OCTAVE, 2, 0],
        [BEYOND - 1, 1, 2**24 - 1],
    ]
    assert rows.tolist()[5] == [BEYOND, 2, 0]
    # All but the five that are zero or not finite have their value back.
    source = SketchCoefficients([Sketch.of(w[:9])], [0.0])
    np.testing.assert_allclose(source.sample(0, 9), sorted(np.abs([0, 0, 0, 0, *w[4:9]])), rtol=2**-31)


@pytest.mark.parametrize(
    "rows",
    [
        [[1, 2]], [[5, 1, 0], [5, 1, 0]], [[5, 0, 0]], [[5, 1, 1 << 24]], [[5, 1, -1]], [[-1, 1, 0]],
        [[BEYOND + 1, 1, 0]], [[0, 1, 1]], [[5.0, 1.0, 0.0]], ["a sketch"],
    ],
)  # fmt: skip
def test_what_is_no_sketch_is_refused(rows):
    with raises(gmwm.errors.ReadError, argument="rows"):
        Sketch.from_array(rows)


def test_kernels_refuse_what_does_not_fit():
    total = _core.running_sum(white(100))
    for level in (0, 7, 63):
        with pytest.raises(ValueError, match=r"^level "):
            _core.haar_sketch(total, level, 0, 100)
    for begin, end in ((3, 2), (0, 101)):
        with pytest.raises(ValueError, match=r"^begin and end "):
            _core.haar_sketch(total, 1, begin, end)
    with pytest.raises(gmwm.errors.DataError):
        Sketch.of(np.zeros((3, 3)))


# --- all levels -------------------------------------------------------------------------------------


def test_levels_of_a_record_in_parts():
    x = np.round(2 * white(5000))
    whole, half = _core.running_sum(x), _core.running_sum(x[:2500])
    first = Sketches.of_haar(half, 6, 0)
    second = Sketches.of_haar(whole, 6, 2500)
    joint = first.merge(second)
    expected = robust_variances(HaarCoefficients(x, 6)).variance
    np.testing.assert_allclose(robust_variances(SketchCoefficients.of(joint, 6)).variance, expected, rtol=1e-5)
    np.testing.assert_array_equal(joint.resolutions, np.maximum(first.resolutions, second.resolutions))
    deep = joint.merge(Sketches.at(9, Sketch.of(white(50)), 0.5))
    assert [len(sketch) for sketch in deep.levels] == [5000 - 2**j + 1 for j in range(1, 7)] + [0, 0, 50]
    assert deep.resolutions.tolist() == [*joint.resolutions.tolist(), 0.0, 0.0, 0.5]
    again = Sketches.from_arrays(*deep.to_arrays())
    for a, b in zip(again.levels, deep.levels, strict=True):
        assert same(a, b)
    np.testing.assert_array_equal(again.resolutions, deep.resolutions)


def test_no_level_at_all():
    for none in (Sketches(), Sketches.of_haar(_core.running_sum(white(1)), 6, 0)):
        assert none.levels == ()
        assert Sketches.from_arrays(*none.to_arrays()).levels == ()
        assert len(none.merge(Sketches.at(2, Sketch.of([1.0]), 0.0)).levels[1]) == 1


@pytest.mark.parametrize("rows", [[[3, 5, 1, 0]], [[0, 5, 1, 0]], [[5, 1, 0]], [[1, 5, 0, 0]]])
def test_rows_of_other_levels_are_refused(rows):
    with raises(gmwm.errors.ReadError, argument="rows"):
        Sketches.from_arrays(rows, [0.0, 0.0])


# --- the source of a robust variance -----------------------------------------------------------------


def test_it_answers_as_the_coefficients_themselves():
    w = np.abs(np.concatenate([white(9000), np.zeros(1000)]))
    source, plain = SketchCoefficients([Sketch.of(w)], [0.0]), PlainCoefficients([w], [0.0])
    assert source.counts.tolist() == [10_000]
    limits = np.array([20.0])
    for got, expected in zip(source.sums(limits), plain.sums(limits), strict=True):
        np.testing.assert_allclose(got, expected, rtol=1e-6)
    assert source.sums(np.zeros(1))[2].tolist() == [0.0]
    np.testing.assert_allclose(source.sample(0, 10_000), np.sort(w), rtol=8e-3)
    np.testing.assert_allclose(source.sample(0, 99), np.quantile(w, (np.arange(99) + 0.5) / 99), rtol=1e-2)
    below, kept = source.between(0, 0.5, 0.6)
    inside = np.count_nonzero((w > 0.5) & (w <= 0.6))
    assert below == pytest.approx(np.count_nonzero(w <= 0.5), rel=5e-3)
    assert kept.size == pytest.approx(inside, rel=0.05)
    assert source.between(0, 0.0, 0.0)[0] == 1000
    assert source.median(0) == pytest.approx(np.median(w), rel=1e-3)


@deterministic
@given(seeds, st.integers(3, 60_000))
def test_medians_of_all_sources(seed, size):
    w = white(size, seed)
    expected = np.median(np.abs(w))
    plain = PlainCoefficients([w], [0.0])
    pooled = PooledCoefficients([PlainCoefficients([part], [0.0]) for part in np.array_split(w, 2)])
    assert plain.median(0) == pooled.median(0) == expected
    # Of neighbours in a bin one may stand for the other.
    assert SketchCoefficients([Sketch.of(w)], [0.0]).median(0) == pytest.approx(expected, rel=8e-3 if size > 9 else 1)


SIGNALS = {
    "white": white(150_000),
    "walk": np.cumsum(white(150_000)),
    "markov": lfilter([0.1], [1, -0.995], white(150_000)) + white(150_000, 1),
    "drift": white(150_000) + 1e-3 * np.arange(150_000),
    "sine": np.sin(0.01 * np.arange(150_000)) + 0.01 * white(150_000),
    "outliers": np.where(rng(1).random(150_000) < 0.01, 1e4, white(150_000)),
    "heavy tails": rng(3).standard_t(1.5, size=150_000),
    "coarse": np.round(0.7 * white(150_000)),
    "coarse, in g": 9.81 + 0.0033 * np.round(0.7 * white(150_000) + np.cumsum(0.01 * white(150_000, 1))),
    "very coarse": np.round(0.3 * white(150_000)),
    "fine steps": 0.0033 * np.round(3 * white(150_000)),
    "short": white(1000),
    "constant": np.full(5000, 9.81),
}


@pytest.mark.slow
@each("efficiency", [0.3, 0.6, 0.9])
@each("name", SIGNALS)
def test_accuracy(name, efficiency):
    x = SIGNALS[name]
    levels = x.size.bit_length() - 1
    exact = HaarCoefficients(x, levels)
    cuts = [0, x.size // 3, x.size // 2, x.size]
    parts = [[Sketch.of_haar(exact.sum, j, *ends) for ends in pairwise(cuts)] for j in range(1, levels + 1)]
    sketches = [a.merge(b).merge(c) for a, b, c in parts]
    expected = robust_variances(exact, efficiency)
    source = SketchCoefficients(sketches, [exact.resolution(k) for k in range(levels)])
    np.testing.assert_array_equal(source.counts, exact.counts)
    found = robust_variances(source, efficiency)
    assert found.diagnostics["outcome"] == expected.diagnostics["outcome"]
    for k, outcome in enumerate(expected.diagnostics["outcome"]):
        # Without a root it is the median, at the mercy of where in its bin the coefficients near it lie; and at an
        # efficiency of 0.3 roots of coarse levels are flat ones.
        tolerance = 8e-3 if outcome == "mad" else 1e-4 if efficiency == 0.3 else 3e-5
        assert found.variance[k] == pytest.approx(expected.variance[k], rel=tolerance, abs=0), k + 1
    assert max(sketch.counts.nbytes + sketch.sums.nbytes for sketch in sketches) < 150_000
    assert max(sketch.to_array().nbytes for sketch in sketches) < 60_000


@pytest.mark.parametrize("efficiency", [0.3, 0.6, 0.9])
@pytest.mark.parametrize("octave", [0.0, 0.3, 0.9])
def test_no_distribution_within_a_bin_costs_more_than_its_width_squared(efficiency, octave):
    # The worst for a mean: all values at both edges of their bins; and with a few at one edge to pull it there.
    w = np.abs(white(100_000)) * 2.0**octave
    step = 2.0 ** (np.floor(np.log2(w)) - 7)
    low = np.floor(w / step) * step
    for share in (0.5, 0.1):
        edges = np.where(rng(1).random(w.size) < share, low, np.nextafter(low + step, 0.0))
        assert sketched(edges, efficiency) == pytest.approx(robust_variance(edges, efficiency), rel=3e-5)


def test_one_value_to_its_last_kept_digit():
    for value in (0.1, 1 / 3, math.pi, 1.999):
        w = np.full(50_000, value)
        assert sketched(w) == pytest.approx(robust_variance(w), rel=2e-9)


@pytest.mark.parametrize("sizes", [(1,), (2,), (3,), (2048,), (2049,)])
def test_few_coefficients(sizes):
    for n in sizes:
        w = white(n, n)
        assert sketched(w) == pytest.approx(robust_variance(w), rel=2e-5)


def test_infinite_coefficients_are_outliers():
    w = white(100_000)
    far = w.copy()
    w[:2000], far[:2000] = 1e12, np.inf
    assert sketched(far) == pytest.approx(robust_variance(w), rel=1e-6)


def test_beyond_its_breakdown_it_is_the_median():
    w = white(100_000)
    w[:35_000] = 1e6
    expected = (np.median(np.abs(w)) / 0.6744897501960817) ** 2
    assert sketched(w) == pytest.approx(expected, rel=1e-3)
    coarse = np.where(np.arange(w.size) < 35_000, 1e6, 0.3 * np.round(w))
    assert sketched(coarse) == pytest.approx((0.3 / 0.6744897501960817) ** 2, rel=1e-8)
