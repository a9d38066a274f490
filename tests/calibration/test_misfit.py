"""Remarks on rejected models, on axes without a test for outliers, and on short recordings."""

from dataclasses import replace

import numpy as np
import pytest

import gmwm
from gmwm.base.remarks import Quantity, Severity
from gmwm.calibration.findings import CLOSE_MISFIT, LARGE_MISFIT, LEAST_SCALES_FOR_USE, remarks_of
from gmwm.calibration.misfit import misfit_of
from gmwm.fitting.estimation.model_error import JUDGED_FREEDOM
from gmwm.theory.processes import Process, registry
from tests.helpers import code_of, codes, only

from .conftest import WITHIN


@pytest.fixture(scope="module")
def without_random_walk():
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7) + RW(gamma2=2e-11)"}, rate=100.0, samples=100_000, rng=4)
    return gmwm.calibrate(imu, "WN")


@pytest.mark.slow
def test_the_remark_has_the_worst_level_and_its_ratio(without_random_walk):
    found = without_random_walk.axes["gyro_x"]
    at, wv = misfit_of(found), found.fit.wavelet_variance
    (level,) = np.flatnonzero(wv.tau == at.tau)
    assert at.ratio == found.fit.implied[level] / wv.variance[level]
    assert not wv.lower[level] <= found.fit.implied[level] <= wv.upper[level]
    assert at.times > LARGE_MISFIT
    remark = only(without_random_walk.remarks, "model-misfit", "gyro_x")
    assert remark.severity is Severity.UNUSABLE
    assert (remark.facts["tau"], remark.facts["ratio"]) == (Quantity(at.tau, "s"), at.times)
    assert remark.facts["side"] == "below"
    assert "model-rejected:calibration" not in codes(without_random_walk.remarks)
    assert without_random_walk.number_verdicts["gyro_x"]["B"].reason == remark
    assert code_of(without_random_walk.verdict) == "verdict:usable"


def test_the_remark_has_the_numbers_at_the_scales_of_the_misfit(without_random_walk):
    found = without_random_walk.axes["gyro_x"]
    # The same model, with data that differ from it where N is read.
    wv, raised = found.fit.wavelet_variance, found.fit.implied.copy()
    raised[0] *= 4
    fit = replace(found.fit, wavelet_variance=replace(wv, variance=raised, lower=0.99 * raised, upper=1.01 * raised))
    remark = only(replace(without_random_walk, axes={"gyro_x": replace(found, fit=fit)}).remarks, "model-misfit")
    assert remark.facts["numbers"] == ("N",)
    assert remark.facts["ratio"] == pytest.approx(4)
    assert (remark.facts["side"], remark.facts["tau"]) == ("below", Quantity(wv.tau[0], "s"))


def test_a_misfit_at_scales_that_a_filter_follows_affects_k(calibration):
    found = calibration.axes["gyro_x"]
    wv, sheet = found.fit.wavelet_variance, found.datasheet
    for level in (0, int(np.searchsorted(wv.tau, sheet["N"].value / sheet["K"].value))):
        raised = found.fit.implied.copy()
        raised[level] *= 4
        fit = replace(found.fit, wavelet_variance=replace(wv, variance=raised, lower=0.9 * raised, upper=1.1 * raised))
        assert ("K" in misfit_of(replace(found, fit=fit)).numbers) == (level > 0)


def test_a_near_model_is_rejected_and_can_be_used(without_random_walk):
    found = without_random_walk.axes["gyro_x"]
    near = found.fit.implied * 1.2
    wv = replace(found.fit.wavelet_variance, variance=near, lower=0.99 * near, upper=1.01 * near)
    there = replace(without_random_walk, axes={"gyro_x": replace(found, fit=replace(found.fit, wavelet_variance=wv))})
    assert misfit_of(there.axes["gyro_x"]).times == pytest.approx(1.2)
    assert only(there.remarks, "model-rejected:calibration", "gyro_x").severity is Severity.BIASED
    assert "model-misfit" not in codes(there.remarks)
    assert code_of(there.verdict) == "verdict:usable"


@pytest.mark.parametrize(("factor", "scales", "mark"), [(1.2, "fast", "≤"), (0.8, "fast", "≤"), (1.2, "slow", "✓")])
def test_n_is_a_limit_if_a_rejected_model_can_move_it_out_of_its_interval(without_random_walk, factor, scales, mark):
    # A wandering line: N was 4 to 23 % too large, with the mark use. Beside slow swings N is right.
    found = without_random_walk.axes["gyro_x"]
    wv, sheet = found.fit.wavelet_variance, found.datasheet
    near = found.fit.implied * np.where((wv.tau < 2) == (scales == "fast"), factor, 1.0)
    fit = replace(found.fit, wavelet_variance=replace(wv, variance=near, lower=0.99 * near, upper=1.01 * near))
    entries = tuple(replace(e, low=0.97 * e.value, high=1.03 * e.value) for e in sheet.values())
    there = replace(found, fit=fit, datasheet=replace(sheet, entries=entries))
    verdict = replace(without_random_walk, axes={"gyro_x": there}).number_verdicts["gyro_x"]["N"]
    assert verdict.usability.mark == mark
    assert verdict.reason is None or verdict.reason.code == "model-rejected"


def test_the_advice_names_the_sinusoidal_process(without_random_walk):
    lines = [name for name, kind in registry.items() if kind.line is not Process.line]
    remark = only(without_random_walk.remarks, "model-misfit")
    assert (remark.facts["line"], remark.facts["sinusoid"]) == ("no", lines[0])
    assert lines[0] in remark.text()
    assert "within=" in remark.text()


def test_the_same_misfit_of_several_axes_is_one_text(without_random_walk):
    found = without_random_walk.axes["gyro_x"]
    both = replace(without_random_walk, axes={"gyro_x": found, "gyro_y": found})
    assert codes(both.remarks).count("model-misfit") == 2
    assert both.summary(every=True).count("[model-misfit]") == 1


@pytest.mark.slow
def test_a_model_with_a_sinusoid_is_fitted_to_the_classical_curve_with_its_outliers():
    # Knocks and a hum: after the advice to add a sinusoid, the calibration must succeed.
    truth = "WN(sigma2=4e-7) + SIN(frequency=21.3, power=6e-7)"
    hum = gmwm.simulate({"gyro_x": truth}, rate=100.0, samples=60_000, rng=3)
    values = hum["gyro_x"].values.copy()
    for start in range(1000, 59_000, 700):
        values[start : start + 160] += 0.006 * np.random.default_rng(start).standard_normal(160)
    imu = gmwm.Imu.from_arrays({"gyro_x": values}, rate=100.0)
    without = gmwm.calibrate(imu, "GM + WN")
    assert without.axes["gyro_x"].fit.wavelet_variance.robust
    assert only(without.remarks, "model-misfit").facts["line"] == "no"
    found = gmwm.calibrate(imu, "GM + WN + SIN")
    assert found.failed == {}
    assert not found.axes["gyro_x"].fit.wavelet_variance.robust
    frequency = found["gyro_x"].parameters["SIN.frequency"]
    assert frequency == pytest.approx(21.3, rel=0.05)
    kept = only(found.remarks, "outliers-found:fit", "gyro_x")
    assert (kept.facts["line"], kept.severity) == ("yes", Severity.BIASED)
    assert "skip=" in kept.text()
    assert "outliers-left-out" not in codes(found.remarks)


def test_a_model_within_the_limits_has_no_misfit(calibration):
    found = calibration.axes["gyro_x"]
    wv = replace(found.fit.wavelet_variance, lower=found.fit.implied / 2, upper=found.fit.implied * 2)
    assert misfit_of(replace(found, fit=replace(found.fit, wavelet_variance=wv))) is None


def test_outliers_that_could_not_be_tested_get_a_remark():
    rng = np.random.default_rng(1)
    coarse = gmwm.Signal(np.round(rng.normal(0.0, 0.3, 20_000)) * 1e-3, 100.0, "rad/s", "gyro_x")
    found = gmwm.calibrate(coarse, "WN")
    assert not found.verdicts["gyro_x"].tested.any()
    (row,) = [line for line in found.summary(details=True).splitlines() if line.startswith("  outliers  ")]
    assert row.split("  ")[-1].strip() == "not tested"
    remark = only(found.remarks, "outliers-not-tested:fit", "gyro_x")
    assert remark.severity is Severity.UNCERTAIN
    assert remark.facts["reason"] == found.verdicts["gyro_x"].reason


@pytest.mark.parametrize(("samples", "short"), [(200, True), (3000, False)])
def test_a_recording_of_a_few_scales_cannot_be_calibrated(samples, short):
    imu = gmwm.simulate({"gyro_x": "WN(sigma2=4e-7)"}, rate=100.0, samples=samples, rng=1)
    found = gmwm.calibrate(imu, "WN")
    remarks = [remark for remark in found.remarks if remark.code == "too-short"]
    assert (found.verdict.severity is Severity.UNUSABLE) is bool(remarks) is short
    for remark in remarks:
        assert (remark.subject, remark.facts["least"]) == ("gyro_x", LEAST_SCALES_FOR_USE)
        assert remark.facts["scales"] < LEAST_SCALES_FOR_USE


@pytest.mark.slow
def test_axes_of_several_lengths_have_a_remark_each(imu):
    found = gmwm.calibrate(
        {
            "gyro_x": imu["gyro_x"],
            "accel_x": gmwm.Signal(imu["accel_x"].values[:20_000], 50.0, "m/s²", "accel_x"),
        },
        WITHIN,
    )
    text = " ".join(found.summary().split())
    assert "20000 to 100000 samples at 50 to 100 Hz, 6.7 min to 17 min" in text
    scales = [remark.facts for remark in found.remarks if remark.code == "longest-scale"]
    assert [facts["duration"] for facts in scales] == [Quantity(1000.0, "s"), Quantity(400.0, "s")]
    assert scales[0]["scale"] == Quantity(163.84, "s")


@pytest.mark.slow
def test_a_unit_that_contradicts_the_file_gets_a_remark(tmp_path):
    path = tmp_path / "named.csv"
    values = gmwm.simulate({"gyro_x": "WN(sigma2=1e-8)"}, rate=100.0, samples=5000, rng=1)["gyro_x"].values
    path.write_text("gyro_x [rad/s]\n" + "\n".join(map(repr, values.tolist())) + "\n", encoding="utf-8")
    remark = only(
        gmwm.calibrate(gmwm.read(path, rate=100.0, units={"gyro": "deg/s"}), "WN").remarks, "unit-contradicted:declared"
    )
    assert (remark.facts["unit"], remark.facts["stated"]) == ("deg/s", "rad/s")
    same = gmwm.calibrate(gmwm.read(path, rate=100.0, units={"gyro": "rad/s"}), "WN")
    assert "unit-contradicted:declared" not in codes(same.remarks)


def judged(found, largest):
    """The calibration of an axis whose test rejects the model, with a relative misfit."""
    axis = found.axes["gyro_x"]
    test = replace(axis.test, pvalue=1e-9)
    misfit = replace(axis.misfit, largest=largest)
    return replace(found, axes={**found.axes, "gyro_x": replace(axis, test=test, misfit=misfit)})


def test_a_rejected_model_that_is_close_is_used(calibration):
    near = judged(calibration, 0.99 * CLOSE_MISFIT)
    remark = only(near.remarks, "model-close", "gyro_x")
    assert remark.severity is Severity.INFO
    assert remark.facts["largest"] == pytest.approx(99 * CLOSE_MISFIT)
    assert not {"model-rejected:calibration", "model-misfit"} & set(codes(near.remarks))
    far = judged(calibration, 1.01 * CLOSE_MISFIT)
    assert "model-close" not in [remark.code for remark in far.remarks if remark.subject == "gyro_x"]
    assert only(far.remarks, "model-rejected:calibration", "gyro_x").severity is Severity.BIASED
    assert "model-close" not in [remark.code for remark in calibration.remarks if remark.subject == "gyro_x"]


@pytest.mark.parametrize(
    ("factor", "case", "usability"), [(50.0, "below", "do not use"), (0.02, "above", "use as a bound")]
)
def test_a_coarse_scale_far_from_the_model_gets_a_remark(calibration, factor, case, usability):
    assert f"coarse-misfit:{case}" not in codes(calibration.remarks)
    axis = calibration.axes["gyro_x"]
    wv, data = axis.fit.wavelet_variance, axis.fit.wavelet_variance.variance.copy()
    level = int(np.flatnonzero(wv.degrees_of_freedom <= JUDGED_FREEDOM)[1])
    data[level] = axis.fit.implied[level] * factor
    fit = replace(axis.fit, wavelet_variance=replace(wv, variance=data))
    found = replace(calibration, axes={**calibration.axes, "gyro_x": replace(axis, fit=fit)})
    remark = only(found.remarks, f"coarse-misfit:{case}", "gyro_x")
    assert remark.severity is Severity.BIASED
    assert remark.facts["tau"] == Quantity(float(wv.tau[level]), "s")
    assert remark.facts["ratio"] == pytest.approx(50.0)
    # Slow noise of the model that the data do not have makes its numbers too large.
    assert found.number_verdicts["gyro_x"]["B"].usability.value == usability


def test_a_ramp_close_to_the_data_gets_no_remark_on_coarse_scales(calibration, monkeypatch):
    # Beside a strong ramp, a difference of 0.1 % can be more than chance.
    monkeypatch.setitem(remarks_of.__globals__, "implausible_levels", lambda fit: fit.wavelet_variance.tau > 50)
    axis = calibration.axes["gyro_x"]
    for factor, count in ((0.5, 1), (0.96, 0), (1.04, 0), (2.0, 1)):
        close = replace(
            axis.fit, wavelet_variance=replace(axis.fit.wavelet_variance, variance=axis.fit.implied * factor)
        )
        found = replace(calibration, axes={"gyro_x": replace(axis, fit=close)})
        assert len([remark for remark in found.remarks if remark.code == "coarse-misfit"]) == count
