"""`gmwm.compare`: any curves over one another, named by what tells them apart."""

import numpy as np
import pytest

import gmwm
from gmwm.showing.plots import imu
from gmwm.showing.plots.curves import automatic_labels
from gmwm.showing.plots.figure import description
from tests.helpers import raises

SIGNALS = {
    axis: gmwm.Signal(np.random.default_rng(seed).normal(size=4096), 100.0, "rad/s", axis)
    for seed, axis in enumerate(("gyro_x", "gyro_y"))
}
X, Y = (gmwm.wavelet_variance(signal) for signal in SIGNALS.values())
ROBUST = gmwm.wavelet_variance(SIGNALS["gyro_x"], robust=True)
SHARP = gmwm.wavelet_variance(SIGNALS["gyro_x"], robust=True, efficiency=0.9)
WHITE, WALK = gmwm.fit("WN", X), gmwm.fit("QN(q2=fixed(0.01)) + WN", X)
SHORT = gmwm.wavelet_variance(SIGNALS["gyro_x"].values[:1000], 100.0)


def legend(figure):
    return [text.get_text() for text in (figure.legends or [figure.axes[0].get_legend()])[0].get_texts()]


@pytest.mark.parametrize(
    ("items", "labels"),
    [
        ((X,), ["Gyroscope X"]),
        ((X, Y), ["Gyroscope X", "Gyroscope Y"]),
        ((X, ROBUST), ["classical", "robust"]),
        ((X, ROBUST, SHARP), ["classical", "robust, efficiency 0.6", "robust, efficiency 0.9"]),
        ((ROBUST, Y), ["Gyroscope X, robust", "Gyroscope Y, classical"]),
        ((X, X), ["Gyroscope X (1)", "Gyroscope X (2)"]),
        ((WHITE, WALK), ["WN", "QN + WN"]),
        ((X, WHITE), ["Wavelet variance", "WN"]),
        ((WHITE, WHITE), ["Gyroscope X (1)", "Gyroscope X (2)"]),
        ((WALK, gmwm.fit("WN", Y)), ["Gyroscope X, QN + WN", "Gyroscope Y, WN"]),
        ((SHORT, SHORT), ["Wavelet variance (1)", "Wavelet variance (2)"]),
    ],
)
def test_automatic_labels(items, labels):
    assert automatic_labels(items) == labels
    assert [name for name in legend(gmwm.compare(*items)) if not name.endswith(", model")][: len(labels)] == labels


@pytest.mark.slow
def test_curves_are_drawn_as_they_are(tmp_path):
    path = tmp_path / "both.png"
    figure = gmwm.compare(X, ROBUST, labels=["a", "b"], view="allan", units="datasheet", title="Two", path=path)
    lines = {line.get_label(): line for line in figure.axes[0].get_lines()}
    factor = 180 / np.pi * 3600
    for name, wv in (("a", X), ("b", ROBUST)):
        np.testing.assert_allclose(lines[name].get_ydata(), factor * np.sqrt(2 * wv.variance))
    assert path.read_bytes().startswith(b"\x89PNG")


def test_two_fits_of_one_curve_are_named_by_their_models():
    names = ["WN", "WN, model", "QN + WN", "QN + WN, model"]
    assert [name for name in legend(gmwm.compare(WHITE, WALK)) if name in names] == names


def test_fits_are_compared_too():
    fits = [gmwm.fit("WN", wv) for wv in (X, ROBUST)]
    assert set(legend(gmwm.compare(*fits))) >= {"classical", "classical, model", "robust", "robust, model"}


@pytest.mark.parametrize(
    ("items", "labels", "expected", "argument", "got"),
    [
        ((), None, "one or more", "items", ()),
        ((X, Y), ["one"], "2 names", "labels", ["one"]),
        ((X, Y), ["one", "one"], "different", "labels", ["one", "one"]),
        ((X, "wv"), None, "WaveletVariance or Fit", "items", "wv"),
    ],
)
def test_errors(items, labels, expected, argument, got):
    with raises(gmwm.errors.OptionError, expected, argument=argument, got=got):
        gmwm.compare(*items, labels=labels)


def test_units_must_be_one():
    other = gmwm.WaveletVariance.from_values(X.variance, 4096, 100.0, unit="m/s²")
    with raises(gmwm.errors.OptionError, argument="items", got=("deg/h", "mg")):
        gmwm.compare(X, other)


def test_several_curves_in_the_panel_of_an_axis():
    figure = description(imu.plot_imu)({"gyro_x": {"classical": X, "robust": ROBUST}, "gyro_y": Y})
    left, right = figure.rows[0]
    assert left.title == "Gyroscope X"
    assert {mark.label for mark in left.marks} >= {"classical", "robust"}
    assert "classical" not in {mark.label for mark in right.marks}
    with raises(gmwm.errors.OptionError, argument="split", got=False, advises=["split=True"]):
        description(imu.plot_imu)({"gyro_x": {"classical": X, "robust": ROBUST}}, split=False)
