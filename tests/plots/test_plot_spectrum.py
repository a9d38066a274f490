"""The plot of a power spectral density as data: root density, model, lines."""

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.showing.plots.figure import description
from gmwm.showing.plots.spectrum import density_unit, plot_spectra, spectrum_panel
from tests.helpers import raises

RATE, SAMPLES = 100.0, 100_000
MODEL = gmwm.Model.parse("GM(beta=0.5, sigma2=1e-6) + WN(sigma2=4e-6) + SIN(frequency=7.3, power=2e-7)")


@pytest.fixture(scope="module")
def spectrum():
    return gmwm.psd(gmwm.Signal(MODEL.simulate(SAMPLES, RATE, rng=1), RATE, "rad/s", "gyro_x"))


def test_the_curve_is_the_root_of_the_smoothed_density(spectrum):
    panel = spectrum_panel(spectrum)
    smooth = spectrum.smoothed()
    np.testing.assert_allclose(panel["Spectrum"].y, np.sqrt(smooth.density))
    np.testing.assert_allclose(panel["95 % limits"].lower, np.sqrt(smooth.lower))
    assert panel.y.label == "One-sided root density (rad/s/√Hz)"
    assert panel.title == "Gyroscope X"
    np.testing.assert_array_equal(spectrum_panel(smooth)["Spectrum"].y, panel["Spectrum"].y)


def test_units(spectrum):
    panel = spectrum_panel(spectrum, units="datasheet")
    np.testing.assert_allclose(panel["Spectrum"].y, np.degrees(spectrum_panel(spectrum)["Spectrum"].y))
    assert panel.y.label == "One-sided root density (deg/s/√Hz)"
    assert density_unit("g", "datasheet") == ("µg/√Hz", pytest.approx(1e6))
    assert density_unit("", "si") == ("u/√Hz", 1.0)
    with raises(OptionError, argument="units", got="datasheet"):
        density_unit("hPa", "datasheet")
    with raises(OptionError, argument="units", got="deg"):
        density_unit("rad/s", "deg")


def test_the_model_lies_on_the_spectrum(spectrum):
    panel = spectrum_panel(spectrum, model=MODEL)
    model, data = panel["Model: GM + WN + SIN"], panel["Spectrum"]
    away = (np.abs(data.x - 7.3) > 0.5) & (data.x > 0.1)
    assert np.median(data.y[away] / model.y[away]) == pytest.approx(1, abs=0.01)
    # White noise lies at √2 N.
    np.testing.assert_allclose(panel["WN"].y, np.sqrt(2 * 4e-6 / RATE))
    np.testing.assert_allclose(model.y**2, panel["WN"].y ** 2 + panel["GM"].y ** 2)
    # The cross of the sinusoid is as high as its line, whose top is at most 1.4 dB lower between two frequencies.
    (cross,) = panel["line 7.3 Hz"].y
    top = data.y[np.abs(data.x - 7.3) < 0.05].max()
    assert 0.8 < top / cross < 1.1


def test_lines_and_bumps_are_marked_above_their_peaks(spectrum):
    panel = spectrum_panel(spectrum)
    marks, data = panel["Lines: 7.3 Hz"], panel["Spectrum"]
    assert marks.x == pytest.approx([7.3], abs=1e-3)
    assert marks.y[0] > data.y[np.abs(data.x - 7.3) < 0.1].max()
    assert panel.y.limits[0] < data.y.min()
    assert marks.y.max() < panel.y.limits[1]


@pytest.mark.slow
def test_a_panel_for_each_axis(tmp_path):
    imu = gmwm.simulate({"gyro": "WN(sigma2=4e-7)", "accel_z": "WN(sigma2=4e-5)"}, rate=RATE, samples=5000, rng=1)
    spectra = gmwm.psd(imu)
    figure = description(plot_spectra)(spectra, models={"gyro_y": gmwm.WN(sigma2=4e-7)})
    assert [[panel and panel.title for panel in row] for row in figure.rows] == [
        ["Gyroscope X", "Gyroscope Y", "Gyroscope Z"],
        [None, None, "Accelerometer Z"],
    ]
    assert "Model" in figure.rows[0][1].labels
    assert "Model" not in figure.rows[0][0].labels
    spectra.plot(path=tmp_path / "all.png")
    spectra["gyro_x"].plot(path=tmp_path / "one.svg")
    assert (tmp_path / "all.png").stat().st_size > 10_000
    assert (tmp_path / "one.svg").exists()
