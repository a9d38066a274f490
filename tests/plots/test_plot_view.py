import math

import numpy as np
import pytest

from gmwm.base.errors import OptionError
from gmwm.base.units import STANDARD_GRAVITY
from gmwm.showing.plots.labels import axis_title, duration_text, model_text, parameter_text, term_label, view_of
from gmwm.theory.processes import Model, Parameter, registry
from gmwm.theory.processes.oscillator import name_in_text
from tests.helpers import raises


def test_the_wavelet_view_in_si_leaves_the_numbers_alone():
    view, values = view_of("rad/s", "wavelet", "si"), np.array([1e-6, 2e-9])
    np.testing.assert_array_equal(view.height(values), values)
    np.testing.assert_array_equal(view.time(values), values)
    assert view.height_label == "Wavelet variance (rad²/s²)"
    assert view.time_label == "Scale τ (s)"


def test_allan_variance_is_twice_the_wavelet_variance_at_half_the_scale():
    view = view_of("rad/s", "allan", "si")
    # White noise of variance σ² at f Hz: ν² = σ²/2^j, Allan deviation σ/√n over clusters of n = 2^(j−1).
    rate, sigma = 200.0, 3e-4
    scales = 2.0 ** np.arange(1, 12)
    np.testing.assert_allclose(view.time(scales / rate), scales / 2 / rate)
    np.testing.assert_allclose(view.height(sigma**2 / scales), sigma / np.sqrt(scales / 2), rtol=1e-14)


@pytest.mark.parametrize(
    ("unit", "shown", "factor"),
    [
        ("rad/s", "deg/h", 180 / math.pi * 3600),
        ("deg/s", "deg/h", 3600.0),
        ("m/s²", "mg", 1e3 / STANDARD_GRAVITY),
        ("g", "mg", 1e3),
    ],
)
def test_datasheet_units(unit, shown, factor):
    view = view_of(unit, "allan", "datasheet")
    assert view.height_label == f"Allan deviation ({shown})"
    np.testing.assert_allclose(view.height(np.array([0.5])), [factor], rtol=1e-14)
    square = view_of(unit, "wavelet", "datasheet")
    np.testing.assert_allclose(square.height(np.array([2.0])), [2 * factor**2], rtol=1e-14)


def test_si_converts_what_is_not_si():
    view = view_of("deg/s", "allan", "si")
    assert view.unit == "rad/s"
    np.testing.assert_allclose(view.height(np.array([0.5])), [math.pi / 180])


@pytest.mark.parametrize("unit", ["", "volt"])
def test_foreign_units_are_kept_and_have_no_datasheet(unit):
    assert unit in view_of(unit, "wavelet", "si").height_label
    with raises(OptionError, unit or "no unit", argument="units", got="datasheet", advises=["units='si'"]):
        view_of(unit, "wavelet", "datasheet")


@pytest.mark.parametrize(("view", "units"), [("adev", "si"), ("wavelet", "SI"), ("Allan", "si")])
def test_unknown_names_are_errors(view, units):
    argument, got = ("units", units) if view == "wavelet" else ("view", view)
    with raises(OptionError, argument=argument, got=got):
        view_of("rad/s", view, units)


def test_axis_titles():
    assert axis_title("gyro_z") == "Gyroscope Z"
    assert axis_title("accel_x") == "Accelerometer X"
    assert axis_title("turn rate") == "turn rate"


def test_models_in_short():
    assert model_text(["GM[1]", "GM[2]", "WN", "RW"]) == "2·GM + WN + RW"


def test_durations_read_well():
    assert duration_text(3e-6) == "3 µs"
    assert duration_text(119.0) == "120 s"
    assert duration_text(600.0) == "10 min"
    assert duration_text(3 * 86400.0) == "3 d"


@pytest.mark.parametrize("name", sorted(registry))
def test_every_process_has_a_legend_with_units(name):
    process = registry[name].standard([0.6] * len(registry[name].nonlinear_parameters()))
    text = term_label(name, process, view_of("rad/s", "wavelet", "datasheet"), 100.0)
    assert text.startswith(f"{name_in_text(name, process)}: ")
    scale = process.scale_parameter()
    if scale in process.parameters[:2] and scale.signal_power:
        assert "deg/h" in text or "deg²/h²" in text


@pytest.mark.parametrize("name", sorted(registry))
def test_what_is_written_as_a_square_is_shown_as_its_root_in_the_unit(name):
    scale = registry[name].scale_parameter()
    if scale.signal_power != 2:
        pytest.skip("its scale is no variance")
    text = parameter_text(scale, 4e-8, view_of("rad/s", "allan", "si"))
    root = scale.symbol.removesuffix("²")
    assert text == (f"{root} = 2×10⁻⁴ rad/s" if root != scale.symbol else f"{root} = 4×10⁻⁸ rad²/s²")


def test_legends_of_terms_with_many_parameters_are_short():
    shown = view_of("rad/s", "wavelet", "si")
    frequency = Parameter("frequency", "f₀", "frequency", time_power=-1, unit_name="Hz")
    texts = [parameter_text(frequency, value, shown) for value in (0.7, 50.0, 250.0, 999.6, 2e-5)]
    assert texts == ["0.700 Hz", "50.0 Hz", "250 Hz", "1000 Hz", "2×10⁻⁵ Hz"]
    assert parameter_text(Parameter("phi2", "φ₂", "coefficient", domain="real"), -0.6, shown) == "φ₂ = −0.6"
    many = Model.parse("ARMA(2, 1, phi1=1.4, phi2=-0.6, theta1=0.3, sigma2=1)")
    assert term_label(many.terms[0], many.processes[0], shown, 1.0) == "ARMA(2,1): φ₁ = 1.4, φ₂ = −0.6, …"


def test_lines_are_told_by_their_frequency_and_amplitude():
    line = Model.parse("SIN(frequency=60, power=2e-8)")
    for units, amplitude in (("si", "2×10⁻⁴ rad/s"), ("datasheet", "41 deg/h")):
        text = term_label("SIN[2]", line.processes[0], view_of("rad/s", "wavelet", units), 250.0)
        assert text == f"line 60 Hz: A = {amplitude}"
