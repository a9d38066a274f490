"""The plot of an error budget shows its numbers."""

import numpy as np
import pytest

from gmwm.applications.navigation import budget
from gmwm.applications.navigation.plot import plot_budget
from gmwm.showing.plots.figure import description

NOISE = {
    "gyro_x": "WN(sigma2=1e-6) + GM(beta=0.1, sigma2=1e-9)", "gyro_y": "WN(sigma2=2.5e-6) + RW(gamma2=1e-16)",
    "accel_x": "WN(sigma2=1e-4)", "accel_y": "WN(sigma2=1e-4)",
}  # fmt: skip


@pytest.fixture(scope="module")
def found():
    return budget(NOISE, "10min", rate=100.0)


def test_each_panel_has_the_largest_error_and_its_terms(found):
    figure = description(plot_budget)(found)
    attitude, velocity, position, alignment = figure.panels
    worst = max(("tilt_x", "tilt_y"), key=lambda name: found[name].error[-1])
    assert attitude["total"].y == pytest.approx(found[worst].error)
    for panel, name in ((velocity, "velocity"), (position, "position")):
        largest = max((found[f"{name}_{axis}"] for axis in "xy"), key=lambda one: one.error[-1])
        assert panel["total"].y == pytest.approx(largest.error)
        drawn = [line.label for line in panel.lines if line.label != "total"]
        shares = {label: np.max(values / largest.error) for label, values in largest.terms.items()}
        assert drawn == [label for label, share in shares.items() if share > 0.03]
    assert [line.label for line in alignment.lines][:2] == ["levelling with accel_x", "levelling with accel_y"]


def test_a_term_has_one_stroke_and_no_two_differ_by_colour_alone(found):
    strokes = {}
    for panel in description(plot_budget)(found).panels[:3]:
        for line in panel.lines:
            assert strokes.setdefault(line.label, line.stroke) == line.stroke
    assert len({stroke.dash for stroke in strokes.values()}) == len(strokes)


def test_an_error_above_a_right_angle_is_not_drawn(found):
    (line,) = [
        line for line in description(plot_budget)(found).panels[-1].lines if line.label.startswith("north from gyro_y")
    ]
    assert np.all(np.isnan(line.y) | (line.y < 90))
    only = budget({"gyro_x": "WN(sigma2=1.0)"}, 60.0, rate=100.0)
    panel = description(plot_budget)(only).panels[-1]
    assert not panel.lines  # the legend names no curve that does not exist
    assert "north from gyro_x: above 90°" in panel.texts[0].text


def test_the_oscillations_of_an_axis_are_one_curve():
    peaks = " + ".join(f"OSC(frequency={f}, quality=20.0, sigma2=1e-3)" for f in (0.3, 0.7))
    figure = description(plot_budget)(budget({"accel_x": f"WN(sigma2=1e-6) + {peaks}"}, 60.0, rate=100.0))
    for panel in figure.panels[:-1]:
        assert panel.labels.count("accel_x oscillations") == 1
        assert not any("OSC" in label for label in panel.labels)
        total, both = panel["total"].y, panel["accel_x oscillations"].y
        assert np.all(both <= 1.0001 * total)
        assert both[-1] > 0.5 * total[-1]


def test_one_axis_has_a_picture_too(tmp_path):
    budget({"accel_z": "WN(sigma2=1e-4)"}, 60.0, rate=100.0).plot(path=tmp_path / "b.png")
    assert (tmp_path / "b.png").stat().st_size > 1000
