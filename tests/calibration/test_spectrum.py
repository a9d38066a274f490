"""The spectrum of each axis in a calibration, and what is said about its lines and bumps."""

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Severity
from gmwm.calibration.findings import _oscillators, line_share, oscillations_in_n
from gmwm.measuring.spectrum import Line
from tests.helpers import code_of, only

RATE, SAMPLES = 100.0, 60_000


def recording(amplitude: float, frequency: float = 1.7, seed: int = 1) -> gmwm.Imu:
    rng = np.random.default_rng(seed)
    t = np.arange(SAMPLES) / RATE
    x = 1e-3 * rng.normal(size=SAMPLES) + amplitude * np.sin(2 * np.pi * frequency * t)
    return gmwm.Imu.from_arrays({"gyro_x": x}, rate=RATE)


def codes(calibration: gmwm.Calibration) -> list[str]:
    return [code_of(remark) for remark in calibration.remarks]


@pytest.mark.slow
def test_a_strong_line_is_a_caution():
    found = gmwm.calibrate(recording(5e-4), within="WN + RW")
    (line,) = found.axes["gyro_x"].spectrum.lines
    assert line.frequency == pytest.approx(1.7, abs=3 * line.frequency_error)
    (remark,) = [remark for remark in found.remarks if code_of(remark) == "lines:found"]
    assert remark.severity is Severity.BIASED
    assert remark.subject == "gyro_x"
    assert remark.facts["frequencies"][0].value == line.frequency
    assert remark.facts["amplitudes"][0].unit == "rad/s"
    assert 0.3 < remark.facts["share"] <= 1
    assert "1.7 Hz" in remark.text()
    assert "SIN(frequency=fixed(" in remark.text()


@pytest.mark.slow
def test_a_line_in_the_model_and_a_weak_line_are_information():
    modelled = gmwm.calibrate(recording(5e-4), within=gmwm.WN() + gmwm.SIN(frequency=gmwm.fixed(1.7)))
    assert "lines:known" in codes(modelled)
    assert "lines:found" not in codes(modelled)
    weak = gmwm.calibrate(recording(5e-5, frequency=20.0), within="WN + RW")
    (remark,) = [remark for remark in weak.remarks if code_of(remark) == "lines:known"]
    assert remark.severity is Severity.INFO
    assert remark.facts["share"] < 0.05


@pytest.mark.slow
def test_a_resonance_is_named():
    rng = np.random.default_rng(2)
    radius, angle = np.exp(-np.pi * 20 / 10 / RATE), 2 * np.pi * 20 / RATE
    response = radius ** np.arange(500) * np.sin(angle * np.arange(1, 501)) / np.sin(angle)
    x = np.convolve(rng.normal(size=SAMPLES + 499), response, "valid") * 1e-4 + 1e-3 * rng.normal(size=SAMPLES)
    found = gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": x}, rate=RATE), within="WN + RW")
    (remark,) = [remark for remark in found.remarks if remark.code == "resonance-found"]
    assert remark.facts["frequencies"][0].value == pytest.approx(20, rel=0.03)
    assert remark.facts["widths"][0].value == pytest.approx(2, rel=0.2)


def test_a_slow_oscillation_has_one_remark():
    model = "WN(sigma2=1e-6) + OSC(frequency=0.2, quality=5, sigma2=2e-7)"
    found = gmwm.calibrate(gmwm.simulate({"gyro_x": model}, rate=20.0, samples=60_000, rng=2))
    only(found.remarks, "lines:oscillation", "gyro_x")
    assert "resonance-found" not in codes(found)


def test_an_oscillator_beside_a_ramp_has_a_height():
    """A ramp has no spectral density. `calibrate` failed if its model had both."""
    rng = np.random.default_rng(2)
    time = np.arange(60_000) / RATE
    x = 1e-3 * rng.normal(size=time.size) + 2e-4 * np.sin(2 * np.pi * 20 * time) + 1e-5 * time
    fit = gmwm.fit("WN + OSC + DR", gmwm.wavelet_variance(x, rate=RATE))
    ((frequency, _, height),) = _oscillators(fit)
    assert 10 < frequency < 40
    assert height > 1


def test_share_of_a_line_is_what_it_adds():
    rng = np.random.default_rng(3)
    noise = rng.normal(size=2**16)
    x = noise + 0.3 * np.sin(2 * np.pi * 1.7 * np.arange(2**16) / RATE)
    clean, wv = gmwm.wavelet_variance(noise, RATE), gmwm.wavelet_variance(x, RATE)
    line = Line(
        frequency=1.7, frequency_error=0, amplitude=0.3, amplitude_error=0, width=0, height=10, p_value=0
    )  # fmt: skip
    share, tau = line_share(wv, (line,))
    at = wv.tau.tolist().index(tau)
    assert share == pytest.approx(1 - clean.variance[at] / wv.variance[at], rel=0.1)
    assert share == pytest.approx(np.max(1 - clean.variance[:8] / wv.variance[:8]), rel=0.1)


@pytest.mark.slow
def test_a_calibration_keeps_its_spectrum(tmp_path):
    found = gmwm.calibrate(recording(5e-4), within="WN + RW")
    found.save(tmp_path / "calibration.json")
    again = gmwm.Calibration.load(tmp_path / "calibration.json").axes["gyro_x"].spectrum
    spectrum = found.axes["gyro_x"].spectrum
    assert again.to_dict() == spectrum.to_dict()
    assert again.lines == spectrum.lines
    assert len(spectrum) < 400


def test_no_spectrum_of_a_wavelet_variance():
    found = gmwm.calibrate({"gyro_x": gmwm.wavelet_variance(recording(5e-4)["gyro_x"])}, within="WN + RW")
    assert found.axes["gyro_x"].spectrum is None
    assert "lines:found" not in codes(found)


@pytest.mark.slow
def test_a_peak_of_an_oscillation_of_the_model_is_no_line():
    truth = "WN(sigma2=4e-6) + OSC(frequency=0.4, quality=40, sigma2=1e-6)"
    found = gmwm.calibrate(gmwm.simulate({"gyro_x": truth}, rate=50.0, samples=60_000, rng=3))
    axis = found.axes["gyro_x"]
    assert [line.frequency for line in axis.spectrum.lines] == [pytest.approx(0.4, rel=0.01)]
    assert "OSC" in axis.fit.model.terms
    assert [code for code in codes(found) if code.startswith("lines")] == ["lines:inside"]


@pytest.mark.slow
@pytest.mark.parametrize(("power", "times"), [(2e-7, None), (4e-7, 1.06), (1.2e-6, 1.18)])
def test_an_oscillation_inside_n_is_named(power, times):
    """An oscillation of 0.56 Hz raises N of the white noise by 3, 6 and 18 %; below 5 %, nothing is said."""
    model = f"WN(sigma2=1e-4) + OSC(frequency=0.56, quality=20, sigma2={power})"
    made = gmwm.simulate_signal(model, rate=RATE, samples=400_000, rng=3, unit="rad/s")
    fit = gmwm.fit("WN + OSC(frequency=fixed(0.56), quality=fixed(20))", made.signal)
    remarks = list(oscillations_in_n("gyro_x", fit))
    assert [code_of(remark) for remark in remarks] == ([] if times is None else ["lines:inside"])
    for remark in remarks:
        assert remark.facts["factor"] == pytest.approx(times, rel=0.05)
        assert remark.facts["frequencies"][0].value == pytest.approx(0.56)
