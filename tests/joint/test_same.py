"""Whether two recordings have the same noise."""

import json

import numpy as np
import pytest

import gmwm
from gmwm.applications.several import same
from gmwm.base.errors import DataError, OptionError
from tests.helpers import code_of

RATE = 50.0


def noise(n, seed, scale=1.0, walk=0.0):
    rng = np.random.default_rng(seed)
    return scale * rng.standard_normal(n) + np.cumsum(walk * rng.standard_normal(n))


def test_the_same_noise_is_not_different_and_other_noise_is():
    x = noise(20_000, 1, walk=0.02)
    assert not same(x, noise(30_000, 2, walk=0.02), rate=RATE).differs
    louder = same(x, noise(20_000, 3, scale=1.1, walk=0.02), rate=RATE)
    assert louder.differs
    assert {row.level for row in louder.differences} >= {1, 2}
    assert louder.levels[0].ratio == pytest.approx(1 / 1.1, rel=0.03)
    wandering = same(x, noise(20_000, 4, walk=0.06), rate=RATE)
    assert {row.level for row in wandering.differences} & {8, 9, 10}
    assert not any(row.level == 1 for row in wandering.differences)


def test_order_and_units_do_not_matter():
    x, y = noise(5000, 1), noise(9000, 2, scale=1.05)
    one, turned, scaled = same(x, y, rate=RATE), same(y, x, rate=RATE), same(1e-9 * x, 1e-9 * y, rate=RATE)
    for a, b, c in zip(one.levels, turned.levels, scaled.levels, strict=True):
        assert a.ratio == pytest.approx(1 / b.ratio) == pytest.approx(c.ratio)
        assert (a.pvalue is None) == (a.lower is None) == (b.pvalue is None)
        if a.lower is not None:
            assert a.pvalue == pytest.approx(b.pvalue, rel=1e-6) == pytest.approx(c.pvalue, rel=1e-6)
            assert a.lower == pytest.approx(1 / b.upper, rel=1e-6)
            assert a.lower < a.ratio < a.upper


def test_a_tolerance_makes_p_values_larger_until_the_difference_counts_as_none():
    x, y = noise(20_000, 1), noise(20_000, 3, scale=1.1)
    values = [same(x, y, rate=RATE, tolerance=tolerance).pvalue for tolerance in (0.0, 0.03, 0.06, 0.2)]
    assert values == sorted(values)
    assert values[0] < 1e-6
    assert values[-1] == 1.0


@pytest.mark.slow
def test_heavy_tails_are_no_difference():
    found = [
        same(*np.random.default_rng([3, k]).standard_t(4.5, (2, 20_000)), rate=RATE).differs for k in range(12)
    ]  # fmt: skip
    assert sum(found) <= 2


def test_of_three_recordings_the_one_that_differs_is_named():
    records = [noise(20_000, 1), noise(15_000, 2), noise(20_000, 3, scale=1.1)]
    found = same(*records, rate=RATE, labels=["a", "b", "c"])
    assert found.differences[0].recording == "c"
    assert "c" in found.summary()
    alone = same(records[0], records[1], rate=RATE, labels=["a", "b"])
    assert not alone.differs
    # The mean of the others has the degrees of freedom of both, and the mean weighted by them.
    first = next(row for row in found.levels if row.recording == "c" and row.level == 1)
    assert first.ratio == pytest.approx(1.1, rel=0.02)
    single = same(records[2], records[0], rate=RATE).levels[0]
    assert first.upper - first.lower < single.upper - single.lower


def test_clocks_that_differ_a_little_are_compared():
    one, other = (gmwm.Signal(noise(2000, k), rate) for k, rate in ((1, 99.99), (2, 100.01)))
    assert not same(one, other).differs


def test_axes_of_two_recordings():
    monday, tuesday = (gmwm.simulate("WN(sigma2=4e-8)", rate=RATE, samples=5000, rng=k) for k in (1, 2))
    found = gmwm.same(monday, tuesday)
    assert found.axes == tuple(monday)
    assert not found.differs
    assert [code_of(remark) for remark in found.remarks] == ["recordings-agree:noise"]
    assert json.loads(json.dumps(found.to_dict()))["differs"] is False
    assert found.to_polars().shape[0] == len(found.levels) == 6 * len(found["gyro_x"])
    assert all(axis in found.summary() for axis in monday)
    louder = gmwm.Imu(
        {axis: gmwm.Signal(2 * s.values, RATE, s.unit, axis) for axis, s in tuesday["gyro"].signals.items()}
    )
    changed = gmwm.same(monday, louder)
    assert changed.axes == ("gyro_x", "gyro_y", "gyro_z")
    differ = [(code_of(remark), remark.facts["more"]) for remark in changed.remarks[:3]]
    assert differ == [("recordings-differ:noise", "lower")] * 3
    assert changed.left_out == ("accel_x", "accel_y", "accel_z")
    assert [code_of(remark) for remark in changed.remarks[3:]] == ["not-compared:axis"] * 3


@pytest.mark.parametrize(
    ("x", "y"),
    [
        (gmwm.Signal(noise(100, 1), 10.0), gmwm.Signal(noise(100, 2), 20.0)),
        (gmwm.Signal(noise(100, 1), 10.0, "rad/s"), gmwm.Signal(noise(100, 2), 10.0, "m/s²")),
        (gmwm.Signal(noise(100, 1), 10.0), gmwm.Signal(np.ones(100), 10.0)),
        (gmwm.Imu.from_arrays({"gyro_x": noise(100, 1)}, 10.0), gmwm.Imu.from_arrays({"gyro_y": noise(100, 1)}, 10.0)),
    ],
)
def test_recordings_that_cannot_be_compared_are_refused(x, y):
    with pytest.raises(DataError):
        same(x, y)


@pytest.mark.parametrize(
    "options", [{"tolerance": -0.1}, {"tolerance": "x"}, {"size": 1.0}, {"confidence": 0.1}, {"labels": ["a"]}]
)
def test_options_are_checked(options):
    with pytest.raises(OptionError) as error:
        same(noise(100, 1), noise(100, 2), rate=RATE, **options)
    assert error.value.argument == next(iter(options))


def test_the_parameters_of_a_model_are_compared():
    """The ratios of simulated variances are within their intervals, and the test is the one of the pooled fit."""
    x, y, z = noise(20_000, 1, walk=0.02), noise(30_000, 2, walk=0.02), noise(20_000, 3, scale=1.1, walk=0.05)
    alike = same(x, y, rate=RATE, model="WN + RW")
    assert not alike.differs
    assert [code_of(remark) for remark in alike.remarks] == ["recordings-agree:parameters"]
    found = same(z, x, rate=RATE, model="WN + RW", labels=["loud", "quiet"])
    assert found.differs
    assert found.pvalue < 1e-6
    ratios = {one.name: one for one in found.parameters[0].ratios}
    assert ratios["WN.sigma2"].lower < 1.21 < ratios["WN.sigma2"].upper
    assert ratios["RW.gamma2"].lower < 6.25 < ratios["RW.gamma2"].upper
    assert "WN.sigma2" in found.summary()
    assert json.loads(json.dumps(found.to_dict()))["parameters"][0]["axis"] == "signal"
    pooled = gmwm.fit("WN + RW", [gmwm.wavelet_variance(v, RATE) for v in (z, x)]).replicates
    # Only the covariance from tails, which plain curves do not have, makes a difference.
    assert np.log(found.pvalue) == pytest.approx(np.log(pooled.parameter_pvalue), rel=0.1)
    three = same(x, y, z, rate=RATE, model="WN + RW")
    assert three.parameters[0].largest.recording == "3"


def test_a_wrong_model_is_rejected_and_a_tolerance_needs_no_model():
    x, y = noise(20_000, 1, walk=0.05), noise(20_000, 2, walk=0.05)
    found = same(x, y, rate=RATE, model="WN")
    codes = [code_of(remark) for remark in found.remarks]
    assert "model-rejected:same" in codes
    assert "recordings-agree:parameters" not in codes  # a test that is not valid finds no agreement
    assert "p = 0)" not in found.summary()
    with pytest.raises(OptionError):
        same(x, y, rate=RATE, model="WN + RW", tolerance=0.1)


def test_the_test_of_all_parameters_decides_if_no_interval_excludes_one():
    """Two small differences together are significant (p 0.035), and the remark does not call one of them clear."""
    first, second = noise(20_000, 2, walk=0.02), noise(20_000, 3, scale=1.015, walk=0.023)
    found = same(first, second, rate=RATE, model="WN + RW")
    assert found.differs
    (remark,) = found.remarks
    assert remark.facts["alone"] == "no"
    assert not any(test.differs or test.lower > 1 or test.upper < 1 for test in found.tests)
    louder = same(first, 1.1 * second, rate=RATE, model="WN + RW")
    assert louder.remarks[0].facts["alone"] == "yes"
    assert any(test.differs and test.upper < 1 for test in louder.tests)
