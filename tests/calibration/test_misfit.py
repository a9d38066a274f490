"""What is said of a rejected model, of axes without a test for outliers, and of recordings that are hardly any."""

from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.calibration.misfit import LARGE, misfit
from gmwm.processes import Process, registry

from .conftest import WITHIN


def words(found):
    return " ".join(found.summary().split())


@pytest.fixture(scope="module")
def short_of_a_walk():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)"}, rate=100.0, samples=100_000, rng=4)
    return gmwm.calibrate(imu, "WN")


def test_the_worst_level_is_told_with_its_ratio(short_of_a_walk):
    found = short_of_a_walk.axes["gyro_x"]
    at, wv = misfit(found), found.fit.wavelet_variance
    (level,) = np.flatnonzero(wv.tau == at.tau)
    assert at.ratio == found.fit.implied[level] / wv.variance[level]
    assert not wv.lower[level] <= found.fit.implied[level] <= wv.upper[level]
    assert at.times > LARGE
    text = words(short_of_a_walk)
    assert f"at {at.tau:.3g} s its variance lies {at.times:.2g} times below that of the data" in text
    assert "The values still describe the curve" not in text
    assert "`within` is too small" in text


def test_numbers_at_the_scales_that_are_missed_are_called_wrong(short_of_a_walk):
    found = short_of_a_walk.axes["gyro_x"]
    # The same model, with data that leave it where N is read.
    wv, raised = found.fit.wavelet_variance, found.fit.implied.copy()
    raised[0] *= 4
    fit = replace(found.fit, wavelet_variance=replace(wv, variance=raised, lower=0.99 * raised, upper=1.01 * raised))
    there = replace(short_of_a_walk, axes={"gyro_x": replace(found, fit=fit)})
    assert "lies 4 times below that of the data. N, which is read at short scales, may be wrong" in words(there)


def test_a_near_model_still_describes_the_curve(short_of_a_walk):
    found = short_of_a_walk.axes["gyro_x"]
    near = found.fit.implied * 1.2
    wv = replace(found.fit.wavelet_variance, variance=near, lower=0.99 * near, upper=1.01 * near)
    there = replace(short_of_a_walk, axes={"gyro_x": replace(found, fit=replace(found.fit, wavelet_variance=wv))})
    text = words(there)
    assert misfit(there.axes["gyro_x"]).times == pytest.approx(1.2)
    assert "The values still describe the curve" in text
    assert "`within` is too small" in text


def test_a_periodic_disturbance_is_told_to_be_a_term(short_of_a_walk):
    lines = [name for name, kind in registry.items() if kind.line is not Process.line]
    assert f"gives a curve with teeth: add {lines[0]} to `within`" in words(short_of_a_walk)


def test_causes_are_told_once_for_all_axes(short_of_a_walk):
    found = short_of_a_walk.axes["gyro_x"]
    text = words(replace(short_of_a_walk, axes={"gyro_x": found, "gyro_y": found}))
    assert text.count("does not describe the curve") == 2
    assert text.count("look at the picture where a test rejects") == 1


def test_outliers_leave_a_model_with_a_line_its_classical_curve():
    # Knocks over a hum: the advice of a rejected model, to add a line, must lead to a calibration.
    truth = "WN(sigma2=4e-7) + SIN(frequency=21.3, power=6e-7)"
    hum = gmwm.simulate({"gyro_x": truth}, rate=100.0, samples=60_000, rng=3)
    values = hum["gyro_x"].values.copy()
    for start in range(1000, 60_000, 12_000):
        values[start : start + 100] += 0.004 * np.random.default_rng(start).standard_normal(100)
    imu = gmwm.Imu.from_arrays({"gyro_x": values}, rate=100.0)
    without = gmwm.calibrate(imu, "GM + WN")
    assert without.axes["gyro_x"].fit.wavelet_variance.robust
    assert "a periodic disturbance gives a curve with teeth" in words(without)
    found = gmwm.calibrate(imu, "GM + WN + SIN")
    assert found.failed == {}
    assert not found.axes["gyro_x"].fit.wavelet_variance.robust
    frequency = found["gyro_x"].parameters["SIN.frequency"]
    assert frequency == pytest.approx(21.3, rel=0.05)
    text = words(found)
    assert "fitted with them; no robust curve goes with a sinusoid in `within`, so cut the outliers out" in text
    assert "raise the curve: cut them out (skip=), or record again: no robust curve goes with SIN" in text
    assert "where outliers matter, the robust curve was taken" not in text


def test_a_model_within_the_limits_misses_nothing(calibration):
    found = calibration.axes["gyro_x"]
    wv = replace(found.fit.wavelet_variance, lower=found.fit.implied / 2, upper=found.fit.implied * 2)
    assert misfit(replace(found, fit=replace(found.fit, wavelet_variance=wv))) is None


def test_outliers_that_could_not_be_tested_are_not_called_none():
    rng = np.random.default_rng(1)
    coarse = gmwm.Signal(np.round(rng.normal(0.0, 0.3, 20_000)) * 1e-3, 100.0, "rad/s", "gyro_x")
    found = gmwm.calibrate(coarse, "WN")
    assert not found.verdicts["gyro_x"].tested.any()
    (row,) = [line for line in found.summary().splitlines() if line.startswith("  outliers")]
    assert row.split("  ")[-1] == "not tested"
    told = "gyro_x: outliers were not looked for: no level can be tested, as the output's steps outweigh its noise"
    assert told in words(found)


def test_what_n_counts_is_among_the_notes():
    truth = {"gyro_x": "WN(sigma2=4e-7) + GM(beta=20.0, sigma2=4e-7)"}
    found = gmwm.calibrate(gmwm.simulate(truth, rate=100.0, samples=100_000, rng=1), "GM + WN")
    (note,) = [note for note in found.datasheets["gyro_x"].notes if note.startswith("N counts GM")]
    assert note in found.axes["gyro_x"].notes
    assert note in words(found)
    assert "N white noise density" in words(found)


@pytest.mark.parametrize(("samples", "short"), [(200, True), (3000, False)])
def test_a_recording_of_a_few_scales_is_a_trial(samples, short):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=samples, rng=1)
    assert ("a trial of the plumbing, not a calibration" in words(gmwm.calibrate(imu, "WN"))) is short


def test_axes_of_several_lengths_are_told_as_such(imu):
    found = gmwm.calibrate(
        {
            "gyro_x": imu["gyro_x"],
            "accel_x": gmwm.Signal(imu["accel_x"].values[:20_000], 50.0, "m/s²", "accel_x"),
        },
        WITHIN,
    )
    text = words(found)
    assert "20000 to 100000 samples at 50 to 100 Hz, 6.7 min to 17 min; best model" in text
    assert "gyro_x: 17 min of recording show scales up to 2.7 min well" in text
    assert "accel_x: 6.7 min of recording show scales up to" in text


def test_a_unit_declared_against_the_file_is_told(tmp_path):
    path = tmp_path / "named.csv"
    values = gmwm.simulate({"gyro_x": "WN(sigma2=1e-8)"}, rate=100.0, samples=5000, rng=1)["gyro_x"].values
    path.write_text("gyro_x [rad/s]\n" + "\n".join(map(repr, values.tolist())) + "\n", encoding="utf-8")
    said = "the unit was declared against the file: gyro: deg/s, declared (the file says rad/s)"
    assert said in words(gmwm.calibrate(gmwm.read(path, rate=100.0, units={"gyro": "deg/s"}), "WN"))
    assert said not in words(gmwm.calibrate(gmwm.read(path, rate=100.0, units={"gyro": "rad/s"}), "WN"))
