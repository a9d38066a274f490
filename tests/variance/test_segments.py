"""Wavelet variances of recordings with gaps: the coefficients of all segments together, none across a gap."""

from itertools import accumulate, pairwise

import numpy as np
import pytest

import gmwm
from gmwm import Signal, WaveletVariance, wavelet_variance
from gmwm.base.errors import DataError
from gmwm.measuring.variance.robust import robust_variance
from gmwm.measuring.variance.transform import coefficient_counts, deepest_level, inner_coefficients
from gmwm.theory.filters import find_filter
from tests.helpers import raises

THREE_GAPS = (1000, 611, 2300, 97)


def signal(lengths, seed=1, scale=1.0):
    x = scale * np.random.default_rng(seed).normal(size=sum(lengths))
    return Signal(x, 100.0, "rad/s", "gyro_x", segments=tuple(pairwise(accumulate(lengths, initial=0))))


@pytest.mark.parametrize("transform", ["modwt", "dwt"])
@pytest.mark.parametrize("filter", ["haar", "d4", "la8"])
def test_three_gaps_are_pooled_by_the_number_of_coefficients(filter, transform):
    gapped = signal(THREE_GAPS)
    pooled = wavelet_variance(gapped, filter=filter, transform=transform)
    total, counts = np.zeros((2, len(pooled)))
    for piece in gapped.segment_values():
        alone = wavelet_variance(piece, 100.0, filter=filter, transform=transform)
        total[: len(alone)] += alone.counts * alone.variance
        counts[: len(alone)] += alone.counts
    np.testing.assert_allclose(pooled.variance, total / counts, rtol=1e-12)
    assert pooled.counts.tolist() == counts.tolist()
    assert pooled.samples == sum(THREE_GAPS)
    assert pooled.segments == THREE_GAPS
    assert len(pooled) == deepest_level(max(THREE_GAPS), find_filter(filter), transform)


def test_random_cuts_agree_with_the_definition():
    rng = np.random.default_rng(2)
    for _ in range(20):
        lengths = (*rng.integers(1, 60, size=rng.integers(1, 9)).tolist(), 40)
        gapped = signal(lengths, seed=int(rng.integers(1 << 30)))
        found = wavelet_variance(gapped)
        for j, value in zip(found.levels.tolist(), found.variance.tolist(), strict=True):
            half = 1 << (j - 1)
            w = np.concatenate(
                [
                    [(x[t : t + half].sum() - x[t + half : t + 2 * half].sum()) / (2 * half)
                     for t in range(x.size - 2 * half + 1)]
                    for x in gapped.segment_values()
                ]
            )  # fmt: skip
            assert value == pytest.approx(np.mean(w**2), rel=1e-11)


@pytest.mark.parametrize(("filter", "transform"), [("haar", "modwt"), ("d4", "modwt"), ("haar", "dwt")])
def test_robust_solves_one_equation_over_all_coefficients(filter, transform):
    gapped = signal((6000, 300, 4000, 11, 3))
    gapped = Signal(np.where(np.arange(len(gapped)) % 997 == 5, 300.0, gapped.values), 100.0, segments=gapped.segments)
    found = wavelet_variance(gapped, filter=filter, transform=transform, robust=True)
    wavelet = find_filter(filter)
    for j in (1, 2, 3, 6, len(found)):
        parts = [
            inner_coefficients(x, wavelet, transform, j)[-1]
            for x in gapped.segment_values()
            if coefficient_counts(x.size, np.array([j]), wavelet, transform)[0] > 0
        ]
        w = np.concatenate(parts)
        expected = robust_variance(w) if w.size > 2 else np.mean(w**2)
        assert found.variance[j - 1] == pytest.approx(expected, rel=1e-8)
    # Not so the classical one, with an outlier of 300 in a thousand samples.
    assert found.variance[0] == pytest.approx(0.5, rel=0.1)
    assert wavelet_variance(gapped, filter=filter, transform=transform).variance[0] > 10


def test_without_a_gap_nothing_changes():
    x = signal((4096,))
    assert wavelet_variance(x).segments == ()
    plain = wavelet_variance(x.values, 100.0)
    assert wavelet_variance(x).variance.tolist() == plain.variance.tolist()
    assert "segments" not in wavelet_variance(x).summary()
    assert "in 4 segments" in wavelet_variance(signal(THREE_GAPS)).summary()


def test_degrees_of_freedom_of_long_and_of_very_short_segments():
    long = wavelet_variance(signal((4000, 4000)), levels=4)
    np.testing.assert_allclose(long.degrees_of_freedom, long.counts / 2.0**long.levels, rtol=1e-12)
    # A hundred segments of one coefficient each are a hundred degrees of freedom, not one in 2^j of them.
    short = wavelet_variance(signal((16,) * 100))
    assert short.counts[-1] == 100
    assert short.degrees_of_freedom[-1] == pytest.approx(100)


def test_limits_hold_the_pooled_degrees_of_freedom():
    found = wavelet_variance(signal(THREE_GAPS))
    again = gmwm.measuring.axis_results.chi_square_limits(found.variance, found.degrees_of_freedom, 0.95)
    np.testing.assert_allclose([found.lower, found.upper], again, rtol=1e-12)


def test_a_pooled_result_comes_back_from_its_dictionary():
    found = wavelet_variance(signal(THREE_GAPS), robust=True)
    again = WaveletVariance.from_dict(found.to_dict())
    assert again.to_dict() == found.to_dict()
    assert again.segments == THREE_GAPS
    old = {name: value for name, value in found.to_dict().items() if name != "segments"}
    assert WaveletVariance.from_dict(old).segments == ()


def test_segments_that_are_all_too_short_are_an_error():
    with raises(DataError, 8, argument="x", got=7):
        wavelet_variance(signal((7, 5, 7)))


def test_the_sign_of_a_drift_is_that_within_the_segments():
    rise = np.concatenate([np.arange(500.0), np.arange(500.0) - 2000.0, np.arange(300.0) - 9000.0])
    segments = ((0, 500), (500, 1000), (1000, 1300))
    assert wavelet_variance(Signal(rise, 100.0, segments=segments)).slope == pytest.approx(1.0)
    noisy = Signal(rise + np.random.default_rng(1).normal(0, 3.0, rise.size), 100.0, segments=segments)
    assert gmwm.fit("DR + WN", noisy).parameters["DR.omega"] == pytest.approx(1.0, rel=1e-2)
