"""Allan, Hadamard and total variances: published values, allantools, and the laws they obey."""

from pathlib import Path

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gmwm.base.errors import DataError, OptionError
from gmwm.files.readers import read
from gmwm.measuring.variance import wavelet_variance
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance, total_variance
from gmwm.measuring.variance.clusters import ClusterVariance
from gmwm.recording.signals import Signal
from tests.helpers import each, raises

RECORDING = Path(__file__).resolve().parents[3] / "shared" / "data" / "adis16405_static_1.parquet"

# How to get each variance here, and its deviation there.
MEMBERS = {
    "allan": (lambda x, **o: allan_variance(x, kind="nonoverlapping", **o), allantools.adev),
    "overlapping": (allan_variance, allantools.oadev),
    "modified": (lambda x, **o: allan_variance(x, kind="modified", **o), allantools.mdev),
    "hadamard": (lambda x, **o: hadamard_variance(x, kind="nonoverlapping", **o), allantools.hdev),
    "overlapping hadamard": (hadamard_variance, allantools.ohdev),
    "total": (total_variance, allantools.totdev),
}

# NIST Special Publication 1065, tables 30 and 31: nine frequencies, and a thousand of a generator.
NINE = np.array([892.0, 809, 823, 798, 671, 644, 883, 903, 677])
PUBLISHED_NINE = {
    "allan": {1: 91.22945, 2: 115.8082},
    "overlapping": {1: 91.22945, 2: 85.95287},
    "modified": {1: 91.22945, 2: 74.78849},
    "hadamard": {1: 70.80607, 2: 116.7980},
    "overlapping hadamard": {1: 70.80607, 2: 85.61487},
    "total": {1: 91.22945, 2: 93.90379},
}
PUBLISHED_THOUSAND = {
    "allan": {1: 2.922319e-1, 10: 9.965736e-2, 100: 3.897804e-2},
    "overlapping": {1: 2.922319e-1, 10: 9.159953e-2, 100: 3.241343e-2},
    "modified": {1: 2.922319e-1, 10: 6.172376e-2, 100: 2.170921e-2},
    "hadamard": {1: 2.943883e-1, 10: 1.052754e-1, 100: 3.910861e-2},
    "overlapping hadamard": {1: 2.943883e-1, 10: 9.581083e-2, 100: 3.237638e-2},
    "total": {1: 2.922319e-1, 10: 9.134743e-2, 100: 3.406530e-2},
}

laws = settings(derandomize=True, max_examples=40, deadline=None)


def thousand():
    """The portable generator of the same publication."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


def walks(kind, size=1500):
    x = np.random.default_rng(11).normal(size=size)
    return {"white": x, "walk": np.cumsum(x), "ramp": x + 0.01 * np.arange(size)}[kind]


@pytest.mark.parametrize("member", MEMBERS)
def test_published_values(member):
    measure = MEMBERS[member][0]
    for data, published in ((NINE, PUBLISHED_NINE), (thousand(), PUBLISHED_THOUSAND)):
        expected = published[member]
        got = measure(data, rate=1.0, clusters=list(expected))
        np.testing.assert_allclose(got.deviation, list(expected.values()), rtol=2e-7 if data.size > 9 else 1e-6)


@pytest.mark.slow
@each("data", ["rate", "phase"])
@each("kind", ["white", "walk", "ramp"])
@each("member", MEMBERS)
def test_allantools_says_the_same_at_every_cluster_size(member, kind, data):
    measure, theirs = MEMBERS[member]
    x, rate = walks(kind, 600), 50.0
    ours = measure(x, rate=rate, data=data, clusters="all")
    tau, deviation, _, _ = theirs(x, rate=rate, data_type="freq" if data == "rate" else "phase", taus="all")
    sizes = np.rint(tau * rate).astype(int)
    common, mine, other = np.intersect1d(ours.clusters, sizes, return_indices=True)
    assert common.size >= 149
    np.testing.assert_allclose(ours.variance[mine], deviation[other] ** 2, rtol=1e-10)
    np.testing.assert_allclose(ours.tau[mine], tau[other], rtol=1e-12)


def test_overlapping_allan_is_twice_the_haar_variance():
    x = walks("walk", 4096)
    allan, wv = allan_variance(x, rate=10.0), wavelet_variance(x, rate=10.0)
    np.testing.assert_allclose(allan.variance, 2 * wv.variance, rtol=1e-12)
    np.testing.assert_array_equal(allan.tau, wv.tau / 2)
    np.testing.assert_array_equal(allan.counts, wv.counts)


@pytest.mark.parametrize("member", MEMBERS)
def test_octaves_decades_and_lists_are_parts_of_all(member):
    measure, _ = MEMBERS[member]
    x = walks("walk", 400)
    everything = measure(x, rate=1.0, clusters="all")
    np.testing.assert_array_equal(everything.clusters, np.arange(1, everything.clusters[-1] + 1))
    for choice in ("octave", "decade", [3, 7, 50]):
        part = measure(x, rate=1.0, clusters=choice)
        np.testing.assert_allclose(part.variance, everything.variance[part.clusters - 1], rtol=1e-11)
        np.testing.assert_array_equal(part.counts, everything.counts[part.clusters - 1])
    np.testing.assert_array_equal(measure(x, rate=1.0, clusters="decade").clusters[:5], [1, 2, 4, 10, 20])


@pytest.mark.slow
@laws
@given(power=st.integers(-40, 40), offset=st.floats(-1e3, 1e3), seed=st.integers(0, 2**32 - 1))
def test_scale_and_offset(power, offset, seed):
    x = np.random.default_rng(seed).normal(size=200)
    for measure, _ in MEMBERS.values():
        plain = measure(x, rate=1.0)
        np.testing.assert_allclose(measure(x + offset, rate=1.0).variance, plain.variance, rtol=1e-9)
        scaled = measure(x * 2.0**power, rate=1.0)
        np.testing.assert_allclose(scaled.variance, plain.variance * 4.0**power, rtol=1e-12)
        np.testing.assert_array_equal(scaled.degrees_of_freedom, plain.degrees_of_freedom)
        assert scaled.noise == plain.noise


@pytest.mark.slow
@laws
@given(seed=st.integers(0, 2**32 - 1), rate=st.sampled_from([1e-3, 1.0, 200.0]), size=st.integers(8, 300))
def test_a_rate_and_its_integral_give_the_same(seed, rate, size):
    x = np.random.default_rng(seed).normal(size=size)
    phase = np.concatenate([[0.0], np.cumsum(x)]) / rate + 7.0
    for measure, _ in MEMBERS.values():
        one, other = measure(x, rate=rate), measure(phase, rate=rate, data="phase")
        np.testing.assert_array_equal(one.tau, other.tau)
        np.testing.assert_allclose(one.variance, other.variance, rtol=1e-7)
        assert (one.samples, other.samples) == (size, size + 1)


@pytest.mark.slow
@laws
@given(seed=st.integers(0, 2**32 - 1), slope=st.floats(-10, 10))
def test_hadamard_is_free_of_a_ramp_and_allan_is_not(seed, slope):
    x = np.random.default_rng(seed).normal(size=300)
    ramp = slope * np.arange(300)
    for kind in ("overlapping", "nonoverlapping"):
        plain = hadamard_variance(x, rate=1.0, kind=kind)
        np.testing.assert_allclose(hadamard_variance(x + ramp, rate=1.0, kind=kind).variance, plain.variance, rtol=1e-7)
    alone = allan_variance(ramp, rate=2.0)
    np.testing.assert_allclose(alone.variance, (slope * 2.0 * alone.tau) ** 2 / 2, rtol=1e-9, atol=1e-300)


@pytest.mark.parametrize("member", MEMBERS)
def test_a_constant_has_no_variance(member):
    result = MEMBERS[member][0](np.full(100, 9.81), rate=1.0)
    assert np.all(result.variance == 0)
    assert np.all(result.upper == 0)
    assert set(result.noise) == {"undetermined"}


@pytest.mark.parametrize("member", MEMBERS)
def test_limits_enclose_the_estimate_and_grow_with_confidence(member):
    x = walks("white", 700)
    narrow, wide = (MEMBERS[member][0](x, rate=1.0, confidence=c) for c in (0.5, 0.99))
    assert np.all(wide.lower < narrow.lower)
    assert np.all(narrow.upper < wide.upper)
    assert np.all((wide.lower < wide.variance) & (wide.variance < wide.upper))
    np.testing.assert_allclose(wide.deviation**2, wide.variance)
    np.testing.assert_allclose(wide.lower_deviation**2, wide.lower)
    np.testing.assert_allclose(wide.upper_deviation**2, wide.upper)


def test_a_long_random_walk_keeps_its_digits():
    from tests.oracles import allan as oracle

    x = np.cumsum(np.random.default_rng(5).normal(size=60_000)) + 1e4
    phase = np.concatenate([[0.0], np.cumsum((x - x.mean()).astype(np.longdouble))])
    for n in (1, 10, 1000):
        assert allan_variance(x, 1.0, clusters=[n]).variance[0] == pytest.approx(
            float(oracle.allan(phase, n)), rel=1e-8
        )
        assert hadamard_variance(x, 1.0, clusters=[n]).variance[0] == pytest.approx(
            float(oracle.hadamard(phase, n)), rel=1e-8
        )
    assert allan_variance(x, 1.0, kind="modified", clusters=[40]).variance[0] == pytest.approx(
        float(oracle.modified(phase, 40)), rel=1e-8
    )


# Progress, records, and the door


@pytest.mark.parametrize("clusters", ["octave", "all"])
def test_progress_is_told_before_and_after(clusters):
    told = []
    result = allan_variance(walks("white", 64), 1.0, clusters=clusters, progress=lambda k, n: told.append((k, n)))
    assert told[0] == (0, len(result))
    assert told[-1] == (len(result), len(result))


def test_what_stops_the_progress_stops_the_work():
    done = []

    def stop(k, n):
        done.append(k)
        if k == 5:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        total_variance(walks("white", 200), 1.0, clusters="all", progress=stop)
    assert done == [0, 1, 2, 3, 4, 5]


@pytest.mark.parametrize("member", MEMBERS)
def test_to_dict_and_back(member):
    import json

    signal = Signal(walks("walk", 100), 10.0, "rad/s", "gyro_x")
    result = MEMBERS[member][0](signal)
    assert (result.rate, result.unit, result.axis) == (10.0, "rad/s", "gyro_x")
    again = ClusterVariance.from_dict(json.loads(json.dumps(result.to_dict())))
    assert again.to_dict() == result.to_dict()
    assert again.summary() == result.summary()
    assert "gyro_x" in repr(result)
    assert "<pre>" in result._repr_html_()
    with pytest.raises(ValueError, match="read-only"):
        result.variance[0] = 1.0


def test_units_of_a_phase():
    for unit, of_rate in (("rad", "rad/s"), ("m/s", "m/s²"), ("volt", "volt/s"), ("", "")):
        assert allan_variance(Signal(walks("walk", 50), 1.0, unit), data="phase").unit == of_rate


@pytest.mark.parametrize(
    ("options", "facts"),
    [
        ({"kind": "fancy"}, ("'overlapping', 'nonoverlapping' or 'modified'",)),
        ({"clusters": "octaves"}, ("octave, decade, all or a list of integers",)),
        ({"clusters": [0, 1]}, ("ascending integers from 1 to 50",)),
        ({"clusters": [1, 51]}, ("ascending integers from 1 to 50",)),
        ({"clusters": [4, 2]}, ("ascending integers",)),
        ({"clusters": [1.0, 2.0]}, ("a list of integers",)),
        ({"clusters": []}, ("a list of integers",)),
        ({"data": "angle"}, ("'rate' or 'phase'",)),
        ({"confidence": 95}, ("0.5", "1")),
        ({"rate": -1.0}, ("positive",)),
    ],
)
def test_options_that_are_refused(options, facts):
    (argument,) = options
    with raises(OptionError, *facts, argument=argument):
        allan_variance(walks("white", 100), **({"rate": 1.0} | options))


@pytest.mark.parametrize("data", ["rate", "phase"])
@pytest.mark.parametrize("measure", [allan_variance, hadamard_variance, total_variance])
def test_data_that_are_refused(measure, data):
    bad = walks("white", 100)
    bad[50] = np.nan
    with raises(DataError, index=50, count=1):
        measure(bad, 1.0, data=data)
    with raises(DataError, 8, argument="x"):
        measure(np.ones(7), 1.0, data=data)
    with raises(DataError, "overflow", argument="x"):
        measure(walks("white", 100) * 1e200, 1.0, data=data)
    with raises(DataError, "one-dimensional", argument="x"):
        measure(np.ones((3, 10)), 1.0, data=data)
    with raises(OptionError, argument="rate"):
        measure(Signal(walks("white", 100), 1.0), 2.0, data=data)


def test_hadamard_has_no_modified_kind():
    with raises(OptionError, argument="kind"):
        hadamard_variance(walks("white", 100), 1.0, kind="modified")


@pytest.mark.slow
@pytest.mark.parametrize("axis", ["gyro_z", "accel_x"])
def test_a_real_sensor(axis):
    if not RECORDING.exists():
        pytest.skip("needs the ADIS 16405 recording of ../shared")
    signal = read(RECORDING, rate=100, units={"gyro": "deg/s", "accel": "g"})[axis]
    result = allan_variance(signal)
    tau, deviation, _, _ = allantools.oadev(signal.values, rate=100.0, data_type="freq", taus="octave")
    np.testing.assert_allclose(result.deviation[: tau.size], deviation, rtol=1e-8)
    assert result.noise[0] in ("white FM", "white PM", "flicker PM")
    assert "random walk FM" in result.noise or "flicker FM" in result.noise
