"""The pooled curve of several recordings is that of one recording with gaps between them, and remembers each."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.measuring.covariance import Design, covariance
from gmwm.measuring.variance.pooling import pool, without
from gmwm.measuring.variance.result import WaveletVariance
from gmwm.recording.signals import Signal
from gmwm.theory.processes.model import Model
from tests.helpers import raises

RATE = 100.0
MODEL = Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=1.0) + RW(gamma2=1e-4)")


def recorded(samples, seed, **options):
    return gmwm.wavelet_variance(MODEL.simulate(samples, RATE, rng=seed), RATE, **options)


@pytest.fixture(scope="module")
def days():
    return {"monday": recorded(4000, 1), "tuesday": recorded(9000, 2), "friday": recorded(700, 3)}


def test_it_is_the_curve_of_one_recording_with_gaps(days):
    parts = [MODEL.simulate(n, RATE, rng=seed) for n, seed in ((4000, 1), (9000, 2), (700, 3))]
    ends = np.cumsum([part.size for part in parts]).tolist()
    segments = tuple(zip([0, *ends[:-1]], ends, strict=True))
    starts = tuple((begin + 1000 * k) / RATE for k, (begin, _) in enumerate(segments))
    whole = gmwm.wavelet_variance(Signal(np.concatenate(parts), RATE, segments=segments, starts=starts))
    found = pool(days)
    np.testing.assert_array_equal(found.levels, whole.levels)
    for name in ("variance", "lower", "upper", "counts"):
        np.testing.assert_allclose(getattr(found, name), getattr(whole, name), rtol=1e-12, err_msg=name)
    assert found.segments == whole.segments == (4000, 9000, 700)
    np.testing.assert_allclose(covariance(MODEL, Design.of(found)), covariance(MODEL, Design.of(whole)), rtol=1e-12)


def test_an_offset_of_a_recording_does_not_matter(days):
    moved = days | {"friday": gmwm.wavelet_variance(1e4 + MODEL.simulate(700, RATE, rng=3), RATE)}
    np.testing.assert_allclose(pool(moved).variance, pool(days).variance, rtol=1e-9)


def test_order_scale_and_grouping_do_not_matter(days):
    found, turned = pool(days), pool(dict(reversed(days.items())))
    np.testing.assert_allclose(turned.variance, found.variance, rtol=1e-12)
    np.testing.assert_allclose(covariance(MODEL, Design.of(turned)), covariance(MODEL, Design.of(found)), rtol=1e-12)
    for scale in (1e-12, 1e12):
        small = {name: replace(wv, variance=scale * wv.variance) for name, wv in days.items()}
        np.testing.assert_allclose(pool(small).variance, scale * found.variance, rtol=1e-12)
    rest = without(found, "monday")
    assert list(rest.recordings) == ["tuesday", "friday"]
    np.testing.assert_allclose(
        (rest.counts * rest.variance)[:11] + (days["monday"].counts * days["monday"].variance)[:11],
        (found.counts * found.variance)[:11], rtol=1e-12,
    )  # fmt: skip
    assert without(pool({name: days[name] for name in ("monday", "tuesday")}), "monday").recordings == {}


def test_one_recording_is_itself(days):
    assert pool({"monday": days["monday"]}) is days["monday"]


def test_no_level_is_longer_than_a_recording_that_a_regression_shortened(days):
    cut = days | {"tuesday": days["tuesday"].first(9)}
    assert len(pool(cut)) == 9
    assert len(pool(days)) == 13


def test_common_tails_are_not_averaged_away(days):
    heavy = {name: replace(wv, excess=np.full((len(wv), len(wv)), 1.0 / wv.samples)) for name, wv in days.items()}
    found = pool(heavy)
    assert found.excess[0, 0] == pytest.approx(1.0 / found.samples, rel=0.01)


def test_it_is_saved_with_its_recordings(days):
    found = pool(days)
    again = WaveletVariance.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.to_dict() == found.to_dict()
    assert list(again.recordings) == list(days)
    assert len(found.first(5).recordings["tuesday"]) == 5


def test_recordings_of_different_kinds_are_refused(days):
    day = days["monday"]
    for other, what in (
        (replace(day, unit="rad/s"), "unit"),
        (replace(day, rate=101.0), "rate"),
        (recorded(4000, 1, robust=True), "estimator"),
        (recorded(4000, 1, filter="d4"), "filter"),
    ):
        with raises(DataError, what, "monday", "later", argument="data"):
            pool({"monday": day, "later": other})


def test_a_curve_at_some_levels(days):
    whole = pool(days)
    part = whole.only([7, 2, 3])
    assert part.levels.tolist() == [2, 3, 7]
    assert np.array_equal(part.variance, whole.variance[[1, 2, 6]])
    assert all(one.levels.tolist() == [2, 3, 7] for one in part.recordings.values())
    for levels in ([], [0], [1, 99]):
        with raises(OptionError, "levels"):
            whole.only(levels)


def test_a_fit_without_a_level_does_not_depend_on_it(days):
    wv = days["monday"]
    spoilt = wv.variance.copy()
    spoilt[0] *= 100
    kept = range(2, len(wv) + 1)
    found, same = (gmwm.fit("WN + RW", one.only(kept)) for one in (wv, replace(wv, variance=spoilt)))
    assert found.parameters == same.parameters
    assert found.standard_errors == same.standard_errors
