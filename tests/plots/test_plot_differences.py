"""One list of tests and one plot for every result that answers whether parts differ."""

import math

import numpy as np
import polars
import pytest

import gmwm
from gmwm.applications.fleets.statistics import fleet_statistics
from gmwm.base.errors import DataError
from gmwm.base.results import Difference, DifferenceTests
from gmwm.fitting.inference import noise_against
from gmwm.measuring.variance.pooling import pool
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.results import plot_differences
from tests.helpers import raises

TRUTH = {"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=1e-11)"}


def recordings(*scales):
    rng = np.random.default_rng(1)
    return [scale * rng.normal(size=20_000) for scale in scales]


@pytest.fixture(scope="module")
def noise():
    return gmwm.same(*recordings(1.0, 1.0, 1.1), rate=100.0, labels=["monday", "tuesday", "later"])


@pytest.fixture(scope="module")
def agreement():
    imus = [gmwm.simulate({"gyro_x": f"WN(sigma2={s})"}, rate=100.0, samples=20_000, rng=1) for s in (4e-7, 5e-7)]
    return gmwm.agree([gmwm.calibrate(imu, within="WN") for imu in imus], labels=["old", "new"])


@pytest.fixture(scope="module")
def fleet():
    N = 1e-4 * np.exp(0.1 * np.random.default_rng(2).normal(size=20))
    N[7] *= 4
    rows = {"unit": [f"{k}.csv" for k in range(20)], "axis": "gyro_x", "status": "calibrated", "model": "WN"}
    return fleet_statistics(
        polars.DataFrame(rows | {"N": N, "N_low": 0.98 * N, "N_high": 1.02 * N, "N_unit": "rad/s/√Hz"})
    )


@pytest.fixture(scope="module")
def conditions():
    values = np.random.default_rng(3).normal(size=40_000) * np.exp(np.linspace(0.0, 0.5, 40_000))
    return noise_against(gmwm.Signal(values, 100.0, "rad/s", "gyro_x"), "time", model="WN")


@pytest.fixture(scope="module")
def pooled():
    curves = {name: gmwm.wavelet_variance(x, 100.0) for name, x in zip("ab", recordings(1.0, 1.2), strict=True)}
    return gmwm.fit("WN", pool(curves)).replicates


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["noise", "agreement", "fleet", "conditions", "pooled"])
def test_every_answer_has_tests_of_one_form(kind, request):
    result = request.getfixturevalue(kind)
    assert isinstance(result, DifferenceTests)
    assert any(test.differs for test in result.tests)
    for test in result.tests:
        assert test.name
        assert test.lower is None or test.lower <= test.ratio <= test.upper
        assert not test.differs or test.pvalue <= 0.05
    panel = description(plot_differences)(result).panels[0]
    drawn = [tick.label for tick in panel.y.ticks]
    # A title that names the only recording or unit replaces its name in each row.
    names = [test.name.partition(", ")[0] if panel.title else test.name for test in result.tests]
    assert drawn == [name for name in names if name in drawn]
    assert bool(panel.title) == (
        len({test.name.partition(", ")[2] for test in result.tests}) == 1 and kind != "conditions"
    )


def test_the_ratios_are_those_of_the_parts(agreement, fleet, conditions):
    old, new = agreement.tests[:2]
    assert (old.name, new.name) == ("gyro_x N, old", "gyro_x N, new")
    assert new.ratio / old.ratio == pytest.approx(math.sqrt(5 / 4), rel=0.01)
    assert fleet.tests[0].name == "gyro_x N, 7.csv"
    assert fleet.tests[0].ratio == pytest.approx(4, rel=0.2)
    assert conditions.tests[0].ratio == pytest.approx(math.exp(0.5), rel=0.05)


def test_the_plot_marks_differences_and_draws_the_clearest(noise):
    panel = description(plot_differences)(noise, limit=5).panels[0]
    drawn = [tick.label for tick in panel.y.ticks]
    clearest = sorted(noise.tests, key=lambda test: 1.0 if test.pvalue is None else test.pvalue)[:5]
    assert sorted(drawn) == sorted(test.name for test in clearest)
    assert "the 5 clearest of" in panel.x.label
    assert panel["Differs"].x == pytest.approx([test.ratio for test in noise.tests if test.name in drawn])
    assert noise.plot(limit=5).axes[0].get_xlabel() == panel.x.label


def test_nothing_to_draw_is_an_error():
    class Nothing(DifferenceTests):
        tests = (Difference(name="a", ratio=math.inf),)

        def summary(self):
            return ""

    with raises(DataError, "nothing to draw"):
        description(plot_differences)(Nothing())
