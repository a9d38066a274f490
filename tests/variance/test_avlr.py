"""The slope regression: right where one noise is alone, and wrong in the way it is known to be where two meet."""

import json
from pathlib import Path

import numpy as np
import pytest

from gmwm.base.errors import OptionError
from gmwm.files.readers import read
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance, total_variance
from gmwm.measuring.variance.allan_regression import LAWS, AllanRegression, avlr, coefficient_unit
from gmwm.measuring.variance.clusters import ClusterVariance
from tests.helpers import only, raises

RECORDING = Path(__file__).resolve().parents[3] / "shared" / "data" / "adis16405_static_1.parquet"


def exact(rate=100.0, unit="rad/s", levels=20, **terms):
    """The Allan variance of a sum of terms by IEEE Std 952, without any estimation error."""
    clusters = 2 ** np.arange(levels)
    tau = clusters / rate
    variance = sum((LAWS[term].factor * value * tau ** LAWS[term].slope) ** 2 for term, value in terms.items())
    freedom = np.full(levels, 1e3)
    return ClusterVariance(
        family="allan",
        kind="overlapping",
        clusters=clusters,
        variance=variance,
        lower=variance * 0.9,
        upper=variance * 1.1,
        counts=np.full(levels, 1000),
        degrees_of_freedom=freedom,
        noise=("white FM",) * levels,
        rate=rate,
        samples=2**21,
        unit=unit,
        axis="gyro_x",
    )


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("term", ["Q", "N", "K", "R"])
def test_a_term_alone_is_read_exactly(term, scale):
    found = avlr(exact(**{term: 0.37 * scale}))
    assert found[term].coefficient == pytest.approx(0.37 * scale, rel=1e-12)
    assert found[term].points == 20
    assert set(found.coefficients) <= {term, "B"}


def test_coefficients_stand_where_the_field_reads_them():
    found = avlr(exact(Q=1e-4, N=1e-3, B=1e-2, K=1e-5, R=1e-7))
    for term, tau in {"Q": 3**0.5, "N": 1.0, "K": 3.0, "R": 2**0.5}.items():
        if term in found.coefficients:
            line = found[term]
            assert line.reading_time == pytest.approx(tau)
            assert line.deviation(tau) == pytest.approx(line.coefficient)
    minimum = found["B"]
    assert minimum.deviation(5.0) == pytest.approx(0.6642824702679600 * minimum.coefficient)
    k = np.argmin(found.allan.deviation)
    assert minimum.reading_time == found.allan.tau[k]


def test_all_five_where_they_are_far_apart():
    truth = {"Q": 1e-3, "N": 1e-1, "B": 1.0, "K": 3e-2, "R": 3e-5}
    found = avlr(exact(rate=1e4, levels=44, **truth))
    assert {term: found[term].coefficient for term in truth} == pytest.approx(truth, rel=0.25)


def test_it_is_inconsistent():
    # A perfect curve, so an endless record; yet N is wrong, because K adds to every value it is read from.
    found = avlr(exact(rate=1.0, levels=12, N=1.0, K=0.05))
    assert found["N"].coefficient > 1.005
    assert found["K"].coefficient != pytest.approx(0.05, rel=0.01)


def test_a_curve_that_still_falls_gives_a_bound():
    found = avlr(exact(N=1.0))
    assert found["B"].bound
    assert "B <=" in found.summary()
    assert found["B"].coefficient == pytest.approx(found.allan.deviation[-1] / 0.6642824702679600)
    rising = avlr(exact(K=1.0))
    assert only(rising.remarks, "no-number:slope", "B").facts["reason"] == "rising"
    with raises(OptionError, "B", argument="term", got="B"):
        rising["B"]


def test_estimates_from_white_noise_and_a_random_walk():
    generator = np.random.default_rng(12)
    rate, n, k = 100.0, 0.02, 0.004
    x = generator.normal(size=400_000) * n * rate**0.5 + np.cumsum(generator.normal(size=400_000)) * k / rate**0.5
    found = avlr(x, rate=rate)
    assert found["N"].coefficient == pytest.approx(n, rel=0.03)
    assert found["K"].coefficient == pytest.approx(k, rel=0.5)
    for variance in (allan_variance(x, rate, kind="nonoverlapping"), total_variance(x, rate)):
        assert avlr(variance)["N"].coefficient == pytest.approx(n, rel=0.03)


def test_all_cluster_sizes_are_thinned_to_octaves():
    x = np.random.default_rng(2).normal(size=3000)
    octaves, everything = avlr(x, rate=1.0), avlr(allan_variance(x, 1.0, clusters="all"))
    assert everything["N"].points <= octaves["N"].points + 1
    assert everything["N"].coefficient == pytest.approx(octaves["N"].coefficient, rel=0.05)


def test_ranges_are_obeyed():
    curve = exact(Q=1e-3, N=1e-1, K=1e-2)
    line = avlr(curve, ranges={"N": (0.3, 3.0)})["N"]
    assert 0.3 <= line.first <= line.last <= 3.0
    chosen = (curve.tau >= 0.3) & (curve.tau <= 3.0)
    assert line.points == chosen.sum()
    expected = np.exp(np.mean(np.log(curve.deviation[chosen] * curve.tau[chosen] ** 0.5)))
    assert line.coefficient == pytest.approx(expected)


def test_values_with_little_freedom_are_not_used():
    x = np.random.default_rng(4).normal(size=2000)
    for least in (2.0, 20.0):
        found = avlr(x, rate=1.0, least_freedom=least)
        used = found.allan.tau <= found["N"].last
        assert np.all(found.allan.degrees_of_freedom[used] >= least)


def test_to_dict_and_back():
    found = avlr(exact(N=1e-1, K=1e-2))
    again = AllanRegression.from_dict(json.loads(json.dumps(found.to_dict())))
    assert again.to_dict() == found.to_dict()
    assert again.summary("datasheet") == found.summary("datasheet")
    assert "N=0.1" in repr(found)
    assert "deg/√h" in found.summary("datasheet")
    assert "rad/s/√Hz" in found.summary()
    assert "<pre>" in found._repr_html_()


def test_units_of_coefficients():
    name, factor = coefficient_unit("N", "deg/s", "datasheet")
    assert (name, factor) == ("deg/√h", pytest.approx(60.0))
    assert coefficient_unit("B", "g", "datasheet") == ("mg", pytest.approx(1000.0))
    assert coefficient_unit("K", "rad/s")[0] == "rad/s/√s"
    assert coefficient_unit("Q", "volt") == ("volt·s", 1.0)
    with raises(OptionError, "an angular rate or an acceleration", argument="unit"):
        coefficient_unit("Q", "volt", "datasheet")


def test_what_is_refused():
    x = np.random.default_rng(4).normal(size=2000)
    for other in (hadamard_variance(x, 1.0), allan_variance(x, 1.0, kind="modified")):
        with raises(OptionError, argument="x", advises=("gmwm.allan_variance",)):
            avlr(other)
    with raises(OptionError, argument="terms", expected="among Q, N, B, K, R"):
        avlr(x, 1.0, terms=["P"])
    with raises(OptionError, argument="tolerance"):
        avlr(x, 1.0, tolerance=0.0)
    with raises(OptionError, argument="ranges"):
        avlr(x, 1.0, ranges={"N": (1e5, 1e6)})
    with raises(OptionError, argument="rate"):
        avlr(allan_variance(x, 1.0), 2.0)
    with raises(OptionError, argument="term"):
        avlr(x, 1.0)["P"]
    assert avlr(np.full(100, 3.0), 1.0).coefficients == {}


def test_a_real_sensor():
    if not RECORDING.exists():
        pytest.skip("needs the ADIS 16405 recording of ../shared")
    found = avlr(read(RECORDING, rate=100, units={"gyro": "deg/s", "accel": "g"})["gyro_y"])
    unit, factor = coefficient_unit("N", "rad/s", "datasheet")
    # Its datasheet: 2 deg/√h and 0.007 deg/s of bias stability, typically.
    assert (unit, factor * found["N"].coefficient) == ("deg/√h", pytest.approx(2.0, rel=0.5))
    assert np.degrees(found["B"].coefficient) == pytest.approx(0.007, rel=1.0)
    assert set(found.coefficients) == {"N", "B", "K"}
