import math

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.showing.plots.results import plan_panel, plot_plan
from tests.helpers import raises


@pytest.fixture(scope="module")
def plan():
    return gmwm.plan("GM(beta=8.0, sigma2=1e-6) + WN(sigma2=4e-6) + RW(gamma2=4e-10)", duration=600.0, rate=100.0)


@pytest.mark.slow
def test_the_curves_are_the_numbers_of_the_plan_and_run_on_beyond_it(plan):
    panel = plan_panel(plan)
    curves = [line for line in panel.lines if line.label.split(":")[0] in plan.errors]
    assert [line.label.split(":")[0] for line in curves] == list(plan.errors)
    for line, (name, errors) in zip(curves, plan.errors.items(), strict=True):
        at = np.searchsorted(line.x, plan.durations[-5:])
        np.testing.assert_array_equal(line.x[at], plan.durations[-5:])
        np.testing.assert_allclose(line.y[at], 100 * errors[-5:])
        assert line.y[-1] == pytest.approx(100 * plan.at(line.x[-1])[name])
        assert line.x[-1] >= max(2 * plan.duration, plan.needed()["RW.gamma2"])
    assert panel.x.limits[0] < curves[0].x[0] < curves[0].x[-1] < panel.x.limits[1]
    drawn = np.concatenate([line.y for line in curves])
    assert panel.y.limits[0] < np.nanmin(drawn)
    assert np.nanmax(drawn) < panel.y.limits[1]


@pytest.mark.slow
def test_no_two_curves_differ_by_colour_alone():
    plan = gmwm.plan(
        "GM(beta=8.0, sigma2=1e-6) + GM(beta=0.8, sigma2=1e-6) + GM(beta=0.08, sigma2=1e-6) + WN(sigma2=4e-6)"
        " + QN(q2=1e-6) + RW(gamma2=4e-10)", duration=60.0, rate=100.0,
    )  # fmt: skip
    curves = [line for line in plan_panel(plan).lines if line.label.split(":")[0] in plan.errors]
    assert len(curves) == 9
    assert len({(line.stroke.dash, line.stroke.symbol) for line in curves}) == 9


@pytest.mark.slow
def test_what_is_wanted_what_is_planned_and_what_is_not_seen(plan):
    panel = plan_panel(plan, accuracy=0.05)
    np.testing.assert_array_equal(panel["5 %: chosen accuracy"].y, [5.0, 5.0])
    np.testing.assert_array_equal(panel["10 min: planned duration"].x, [600.0, 600.0])
    band = panel["above 50 %: not determined by the data"]
    np.testing.assert_array_equal(band.lower, [50.0, 50.0])
    assert np.all(np.isinf(band.upper))
    (rings,) = [line for line in panel.lines if not line.stroke.filled]
    assert set(rings.x) <= set(plan.needed(0.05).values())
    assert rings.x.size == 4
    np.testing.assert_array_equal(rings.y, np.full(4, 5.0))
    assert {tick.label for tick in panel.x.opposite} >= {"1 min", "1 h"}


@pytest.mark.slow
def test_what_is_not_determined_is_named(tmp_path):
    plan = gmwm.plan("GM(beta=1e6, sigma2=1e-6) + WN(sigma2=1e-6) + RW(gamma2=1e-8)", duration=100.0, rate=100.0)
    panel = plan_panel(plan, accuracy=0.001)
    assert math.isinf(plan.needed(0.001)["WN.sigma2"])
    assert "WN.sigma2: not determined" in panel.labels
    assert any(label.startswith("RW.gamma2: ") and label != "RW.gamma2: not determined" for label in panel.labels)
    plan.plot(accuracy=0.001, path=tmp_path / "plan.png")
    nothing = gmwm.plan("GM(beta=1e6, sigma2=1e-6) + WN(sigma2=1e-6)", duration=100.0, rate=100.0)
    plot_plan(nothing)


def test_a_curve_that_is_too_high_to_be_drawn_says_so():
    plan = gmwm.plan("WN(sigma2=1.0) + RW(gamma2=1e-16)", duration=60.0, rate=100.0)
    panel = plan_panel(plan)
    (label,) = [label for label in panel.labels if label.startswith("RW.gamma2")]
    assert np.all(np.isnan(panel[label].y))
    assert label.endswith(", above 200 % throughout")
    assert all(np.any(np.isfinite(panel[label].y)) for label in panel.labels if label.startswith("WN"))


@pytest.mark.slow
def test_it_is_drawn(plan, tmp_path):
    figure = plan.plot(path=tmp_path / "plan.pdf")
    assert (tmp_path / "plan.pdf").read_bytes().startswith(b"%PDF")
    assert figure.axes[0].get_ylabel() == "Relative standard error (%)"
    plot_plan(plan, ax=figure.axes[0])
    with raises(OptionError, argument="path", got=str(tmp_path / "plan.bmp")):
        plan.plot(path=tmp_path / "plan.bmp")
    with raises(OptionError, argument="accuracy", got=0.9):
        plan.plot(accuracy=0.9)
