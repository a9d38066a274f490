"""Every axis gets its model and its numbers, even if another axis cannot be calibrated."""

import threading
import warnings
from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError
from gmwm.calibration.averaging import averaged_datasheet, averaged_intervals
from gmwm.calibration.calibrate_recordings import STAGES
from gmwm.choosing.datasheets import model_datasheet, with_limits
from gmwm.choosing.selection.structure import structure_of
from tests.helpers import codes, only, raises
from tests.knocked import TRUTH

from .conftest import WITHIN


def structures(calibration):
    return {axis: structure_of(fit.model) for axis, fit in calibration.items()}


def test_the_truth_is_recommended_on_every_axis(calibration):
    assert structures(calibration) == {axis: structure_of(gmwm.Model.parse(text)) for axis, text in TRUTH.items()}
    assert list(calibration) == list(TRUTH)
    assert calibration.failed == {}


def test_knocked_axes_are_robust_and_the_others_classical(calibration):
    assert {axis: fit.wavelet_variance.robust for axis, fit in calibration.items()} == {
        "gyro_x": False,
        "gyro_y": True,
        "accel_x": False,
    }
    assert [axis for axis, verdict in calibration.verdicts.items() if verdict.contaminated] == ["gyro_y"]
    assert {verdict.comparisons for verdict in calibration.verdicts.values()} == {3}


@pytest.mark.slow
def test_each_axis_is_what_the_pieces_give_by_themselves(imu, calibration):
    for axis in ("gyro_x", "gyro_y"):
        error = calibration[axis].wavelet_variance.model_error
        wv = replace(gmwm.wavelet_variance(imu[axis], robust=axis == "gyro_y"), model_error=error)
        ranking = gmwm.select(WITHIN, wv)
        fit = gmwm.fit(ranking.recommended.model, wv, weighting="optimal")
        found = calibration.axes[axis]
        # The last digits of a covariance depend on which shapes are cached.
        assert calibration[axis].parameters == pytest.approx(fit.parameters, rel=1e-12)
        fit = calibration[axis]
        assert found.ranking.to_dict() == ranking.to_dict()
        sheet = averaged_datasheet(model_datasheet(fit, 0.95), ranking, 0.95)
        assert found.intervals == averaged_intervals(fit, fit.confidence_intervals(), sheet)
        assert found.test is not None
        if error == 0:  # the other was tested before its model error was known
            assert found.test.to_dict() == ranking.recommended.fit.goodness_of_fit().to_dict()
            assert found.test.statistic == pytest.approx(fit.goodness_of_fit().statistic, rel=1e-5)
        assert found.datasheet.to_dict() == with_limits(sheet, fit).to_dict()
        assert fit.gap is not None


@pytest.mark.slow
@pytest.mark.parametrize("robust", [False, True])
def test_robust_can_be_forced(imu, robust):
    found = gmwm.calibrate(imu, "WN + RW", robust=robust, efficiency=0.8, axes=["gyro_x", "gyro_y"])
    assert list(found) == ["gyro_x", "gyro_y"]
    assert {fit.wavelet_variance.robust for fit in found.values()} == {robust}
    assert {fit.wavelet_variance.efficiency for fit in found.values()} == {0.8 if robust else None}
    assert found.verdicts["gyro_y"].contaminated


@pytest.mark.slow
def test_the_number_of_threads_changes_nothing(imu, calibration):
    assert gmwm.calibrate(imu, WITHIN, threads=1).to_dict() == calibration.to_dict()


@pytest.mark.slow
def test_an_axis_that_cannot_be_calibrated_does_not_affect_the_others():
    rng = np.random.default_rng(1)
    recording = {
        "gyro_x": gmwm.Signal(rng.normal(size=20_000) * 1e-3, 100.0, "rad/s", "gyro_x"),
        "gyro_y": gmwm.Signal(np.full(20_000, 0.1), 100.0, "rad/s", "gyro_y"),
        "gyro_z": gmwm.Signal(np.arange(5.0), 100.0, "rad/s", "gyro_z"),
    }
    found = gmwm.calibrate(recording, "WN + RW")
    assert list(found) == ["gyro_x"]
    assert list(found.failed) == ["gyro_y", "gyro_z"]
    assert "constant" in found.failed["gyro_y"]
    assert "at least 8 samples" in found.failed["gyro_z"]
    assert only(found.remarks, "not-calibrated:calibration", "gyro_y").facts["reason"] == found.failed["gyro_y"].rstrip(
        "."
    )
    with raises(DataError, "gyro_y", "constant"):
        found["gyro_y"]
    with raises(DataError, argument="axis", expected="one of gyro_x", got="accel_x"):
        found["accel_x"]
    assert found.get("gyro_y") is None
    assert "gyro_y" not in found


def test_a_recording_without_a_usable_axis_is_an_error():
    with raises(DataError, "gyro_x", "constant"):
        gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": np.zeros(1000), "gyro_y": np.zeros(1000)}, 100.0))


def test_the_advice_for_an_output_of_one_bit_is_for_the_recording():
    x = np.arange(4096) % 2 * 0.01  # every level but the first is zero
    with raises(DataError, "zero at level 2,", advises=["more bits"]):
        gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": x}, 100.0))


def test_a_recording_with_gaps_is_calibrated_from_all_its_segments():
    signal = gmwm.Signal(np.random.default_rng(1).normal(size=1000), 100.0, segments=((0, 400), (400, 1000)))
    calibration = gmwm.calibrate(signal, "WN")
    (axis,) = calibration
    assert calibration[axis].wavelet_variance.segments == (400, 600)
    assert gmwm.Calibration.from_dict(calibration.to_dict()).to_dict() == calibration.to_dict()


@pytest.mark.slow
def test_a_signal_and_a_wavelet_variance_are_calibrated(imu, calibration):
    signal = gmwm.calibrate(imu["gyro_x"], WITHIN)
    assert signal["gyro_x"].to_dict() == calibration["gyro_x"].to_dict()
    curves = gmwm.calibrate({"gyro_x": gmwm.wavelet_variance(imu["gyro_x"])}, WITHIN)
    assert curves["gyro_x"].to_dict() == calibration["gyro_x"].to_dict()
    assert curves.verdicts == {}
    with raises(DataError, "gyro_x", advises=["robust='auto'"]):
        gmwm.calibrate({"gyro_x": gmwm.wavelet_variance(imu["gyro_x"])}, WITHIN, robust=True)


@pytest.mark.slow
def test_progress_reports_every_step_from_one_thread_at_a_time(imu):
    calls, inside = [], threading.Lock()

    def progress(done, steps, text):
        assert inside.acquire(blocking=False)
        calls.append((done, steps, text))
        inside.release()

    gmwm.calibrate(imu, "WN + RW", progress=progress)
    assert [done for done, _, _ in calls] == list(range(1, 3 * len(STAGES) + 1))
    assert {steps for _, steps, _ in calls} == {3 * len(STAGES)}
    assert {text for _, _, text in calls} == {f"{axis}: {stage}" for axis in TRUTH for stage in STAGES}


@pytest.mark.slow
def test_an_interrupt_in_progress_stops_the_work(imu):
    seen = []

    def progress(done, steps, text):
        seen.append(text)
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        gmwm.calibrate(imu, "WN + RW", progress=progress, threads=1)
    assert len(seen) < len(TRUTH) * len(STAGES)


@pytest.mark.slow
def test_remarks_of_fits_are_on_the_axes_and_not_warnings():
    # With GM alone there is nothing to choose, and on white noise it acts as white noise.
    x = gmwm.Model.parse("WN(sigma2=1.0)").simulate(20_000, 100.0, rng=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = gmwm.calibrate(gmwm.Signal(x, 100.0, "rad/s", "gyro_x"), "GM")
    remark = only(found.axes["gyro_x"].remarks, "correlation-time-unknown:fit")
    assert (remark.facts["term"], remark.facts["process"]) == ("GM", "WN")
    assert "correlation-time-unknown:fit" in codes(found.remarks)
    assert "[correlation-time-unknown]" in found.summary(every=True)


@pytest.mark.slow
def test_needed_lengths_hold(imu):
    short = {"gyro_x": gmwm.Signal(imu["gyro_x"].values[:6000], 100.0, "rad/s", "gyro_x")}
    found = gmwm.calibrate(short, gmwm.GM() + gmwm.WN(), robust=False)
    axis = found.axes["gyro_x"]
    poor = {n for n, error in axis.fit.standard_errors.items() if error > 0.5 * abs(axis.fit.parameters[n])}
    assert set(axis.needed) == poor
    remark = only(found.remarks, "poorly-known:fit", "gyro_x")
    assert remark.facts["parameters"] == tuple(axis.needed)
    assert (remark.facts["seen"], remark.facts["wanted"]) == (0.5, 0.2)
    for name, seconds in axis.needed.items():
        if seconds is not None and np.isfinite(seconds):
            plan = gmwm.plan(axis.fit.model, duration=seconds, rate=100.0, weighting="optimal")
            assert plan.at(seconds)[name] <= 0.2
            assert plan.at(seconds / 2)[name] > 0.2


@pytest.mark.parametrize(
    ("options", "argument", "got"),
    [
        ({"robust": "yes"}, "robust", "yes"),
        ({"weighting": "identity"}, "weighting", "identity"),
        ({"criterion": "aic"}, "criterion", "aic"),
        ({"confidence": 95}, "confidence", 95),
        ({"confidence": 0.3}, "confidence", 0.3),
        ({"draws": 50}, "draws", 50),
        ({"rng": -1}, "rng", -1),
        ({"robust": False, "efficiency": 2.0}, "efficiency", 2.0),
        ({"threads": 0}, "threads", 0),
        ({"axes": ["gyro_q"]}, "axes", "gyro_q"),
        ({"axes": []}, "axes", []),
        ({"efficiency": 2.0}, "efficiency", 2.0),
    ],
)
def test_options_are_checked(imu, options, argument, got):
    with raises(OptionError, f"{argument} must be ", repr(got)):
        gmwm.calibrate(imu, "WN", **options)


@pytest.mark.slow
def test_axes_are_named_one_by_one_or_by_their_sensor(imu):
    assert list(gmwm.calibrate(imu, "WN", axes="gyro_x")) == ["gyro_x"]
    assert list(gmwm.calibrate(imu, "WN", axes=["gyro"])) == ["gyro_x", "gyro_y"]


def test_an_array_gets_the_advice_to_make_a_signal():
    for data in (np.zeros(100), {"gyro_x": np.zeros(100)}):
        with raises(OptionError, "ndarray", argument="data", advises=["Signal(x, rate, 'rad/s')"]):
            gmwm.calibrate(data, "WN")


@pytest.mark.parametrize(("axis", "unit"), [("gyro_x", "m/s²"), ("accel_z", "deg/s")])
def test_a_name_and_a_unit_of_two_sensors_are_refused(axis, unit):
    signal = gmwm.Signal(np.random.default_rng(1).normal(size=1000), 100.0, unit, axis)
    with raises(OptionError, axis, unit, argument="data"):
        gmwm.calibrate(signal, "WN")


@pytest.mark.parametrize(
    ("data", "name"), [("static.csv", "str"), (3, "int"), ({}, "empty mapping"), ({"gyro_x": [1.0, 2.0]}, "list")]
)
def test_other_data_are_refused(data, name):
    with raises(OptionError, name, argument="data"):
        gmwm.calibrate(data, "WN")


@pytest.mark.slow
def test_a_generator_draws_the_seed_that_the_settings_record(imu):
    found = gmwm.calibrate(imu["gyro_x"], "WN + RW", rng=np.random.default_rng(2))
    assert found.settings.seed == gmwm.calibrate(imu["gyro_x"], "WN + RW", rng=np.random.default_rng(2)).settings.seed
    again = gmwm.calibrate(imu["gyro_x"], "WN + RW", rng=found.settings.seed)
    assert again.to_dict() == found.to_dict()
    with raises(OptionError, argument="rng", got="three"):
        gmwm.calibrate(imu["gyro_x"], "WN + RW", rng="three")
