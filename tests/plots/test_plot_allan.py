import numpy as np
import pytest

from gmwm.base.errors import OptionError
from gmwm.measuring.variance.allan import allan_variance, hadamard_variance
from gmwm.measuring.variance.allan_regression import avlr
from gmwm.recording.signals import Signal
from gmwm.showing.plots.allan import (
    SLOPES,
    allan_panel,
    avlr_panel,
    plot_allan,
    plot_allan_axes,
    plot_avlr,
)
from gmwm.showing.plots.figure import Polyline, description
from tests.helpers import raises


def signal(axis="gyro_x", unit="rad/s", scale=1.0, seed=1):
    generator = np.random.default_rng(seed)
    x = generator.normal(size=20_000) + np.cumsum(generator.normal(size=20_000)) * 0.01
    return Signal(x * scale, 100.0, unit, axis)


@pytest.fixture(scope="module")
def curve():
    return allan_variance(signal())


def test_the_curve_and_its_band_are_the_numbers_of_the_result(curve):
    panel = allan_panel({"curve": curve}, units="si")
    line, band = panel["curve"], panel["95 % limits, identified noise"]
    np.testing.assert_array_equal(line.x, curve.tau)
    np.testing.assert_array_equal(line.y, curve.deviation)
    np.testing.assert_allclose(band.lower, curve.lower_deviation)
    np.testing.assert_allclose(band.upper, curve.upper_deviation)
    assert panel.x.label == "Averaging time τ (s)"
    assert panel.y.label == "Overlapping Allan deviation (rad/s)"


def test_datasheet_units(curve):
    panel = allan_panel({"curve": curve}, units="datasheet")
    np.testing.assert_allclose(panel["curve"].y, np.degrees(curve.deviation) * 3600)
    assert panel.y.label == "Overlapping Allan deviation (deg/h)"


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e9])
def test_guides_have_their_slopes_and_stay_inside(scale):
    panel = allan_panel({"": allan_variance(signal(scale=scale))})
    guides = [mark for mark in panel.lines if mark.x.size == 2]
    for (label, slope), line, text in zip(SLOPES, guides, panel.texts, strict=True):
        rise = np.diff(np.log(line.y)) / np.diff(np.log(line.x))
        assert rise[0] == pytest.approx(slope, abs=1e-9)
        assert text.text == label
        assert np.all((panel.x.limits[0] < line.x) & (line.x < panel.x.limits[1]))
        assert np.all((panel.y.limits[0] < line.y) & (line.y < panel.y.limits[1]))
        assert 0 < text.x < 1
        assert 0 < text.y < 1
    assert allan_panel({"": allan_variance(signal())}, guides=False).texts == ()


def test_guides_stand_where_the_curve_is_not(curve):
    panel = allan_panel({"": curve})
    pivot = panel.lines[-1]
    near = (curve.tau > pivot.x[0]) & (curve.tau < pivot.x[1])
    heights = curve.deviation[near]
    low, high = min(m.y.min() for m in panel.lines[1:]), max(m.y.max() for m in panel.lines[1:])
    assert not np.any((heights > low) & (heights < high))


def test_the_lines_of_a_regression_and_where_they_are_read(curve):
    found = avlr(curve)
    panel = avlr_panel(found, units="datasheet")
    symbols = {"N": "circle", "B": "triangle", "K": "star"}
    assert set(symbols) <= set(found.coefficients)
    for term, symbol in symbols.items():
        (mark,) = [m for m in panel.lines if m.label.startswith(f"{term} ")]
        line = found[term]
        assert mark.stroke.symbol == symbol
        assert mark.x[0] == pytest.approx(line.reading_time)
        assert mark.y[0] == pytest.approx(np.degrees(line.deviation(line.reading_time)) * 3600)
        assert panel.y.limits[0] < mark.y[0] < panel.y.limits[1] or "outside" in mark.label
        (drawn,) = [m for m in panel.lines if m.stroke.colour == mark.stroke.colour and m is not mark]
        assert np.diff(np.log(drawn.y))[0] / np.diff(np.log(drawn.x))[0] == pytest.approx(line.slope, abs=1e-9)
    assert any("deg/√h, at τ = 1 s" in label for label in panel.labels)


def test_a_place_outside_the_axes_says_so():
    short = allan_variance(Signal(np.random.default_rng(0).normal(size=100), 1e6, "rad/s"))
    assert any("at τ = 1 s (outside the axes)" in label for label in avlr_panel(avlr(short)).labels)


def test_sensors_side_by_side():
    axes = {f"{s}_{k}": (s, u) for s, u in {"gyro": "rad/s", "accel": "m/s²"}.items() for k in "xyz"}
    figure = description(plot_allan_axes)(
        {name: allan_variance(signal(name, unit)) for name, (_, unit) in axes.items()}
    )
    assert [panel.title for panel in figure.panels] == ["Gyroscope", "Accelerometer"]
    for panel in figure.panels:
        assert panel.labels == ("X", "Y", "Z", "95 % limits, identified noise")
        strokes = [m.stroke for m in panel.marks if isinstance(m, Polyline) and m.label]
        assert len({(s.dash, s.symbol) for s in strokes}) == 3


def test_a_constant_says_so():
    panel = allan_panel({"": allan_variance(np.ones(100), 1.0)})
    assert [text.text for text in panel.texts] == ["Every variance is zero"]


@pytest.mark.slow
def test_everything_is_drawn(curve, tmp_path):
    paths = [tmp_path / f"{name}.png" for name in ("curve", "lines", "axes")]
    figure = plot_allan(curve, path=paths[0])
    assert {text.get_text() for text in figure.axes[0].texts} == {label for label, _ in SLOPES}
    avlr(curve).plot(path=paths[1])
    plot_avlr(avlr(curve), guides=False, ax=figure.axes[0])
    plot_allan_axes({"gyro_x": curve, "gyro_y": curve}, units="datasheet", path=paths[2])
    everything = allan_variance(signal().values[:2000], 1.0, clusters="all")
    everything.plot()
    assert allan_panel({"": everything}).lines[0].stroke.symbol is None
    for path in paths:
        assert path.read_bytes().startswith(b"\x89PNG")


def test_what_is_refused(curve):
    for other in (hadamard_variance(signal()), allan_variance(signal(unit="m/s²"))):
        with raises(OptionError, "a: ", "b: ", argument="curves") as caught:
            allan_panel({"a": curve, "b": other})
        assert len(set(caught.value.got)) == 2
    with raises(OptionError, argument="units", got="datasheet", advises=["units='si'"]):
        plot_allan(allan_variance(np.arange(9.0), 1.0), units="datasheet")
    for wrong in ({}, {"a": 1.0}, [curve]):
        with raises(OptionError, "a mapping of names to ClusterVariance", argument="curves", got=wrong):
            plot_allan_axes(wrong)


def test_slopes_of_several_axes_have_a_panel_each():
    names = ("gyro_x", "gyro_y", "accel_x")
    units = {"g": "rad/s", "a": "m/s²"}
    figure = description(plot_allan_axes)({name: avlr(allan_variance(signal(name, units[name[0]]))) for name in names})
    assert [panel.title for panel in figure.panels] == ["Gyroscope X", "Gyroscope Y", "Accelerometer X"]
    for panel in figure.panels:
        assert "Point that gives N" in panel.labels
        assert panel.texts[-1].text.startswith("N = ")
    with raises(OptionError, argument="curves"):
        description(plot_allan_axes)({"gyro_x": 1.0})
