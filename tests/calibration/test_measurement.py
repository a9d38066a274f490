"""The fitted curve of an axis: tails keep the classical one, knocks take the robust one, spikes are replaced."""

import numpy as np
import pytest

import gmwm
from gmwm.calibration.data import Recordings
from gmwm.calibration.measure import measure
from gmwm.calibration.options import CalibrationOptions
from gmwm.measuring.outliers import Replaced
from gmwm.recording import batches
from tests.helpers import codes, only

N, RATE = 60_000, 100.0
WITHIN = "WN + RW"


def signal(seed=1, white=None):
    rng = np.random.default_rng(seed)
    x = rng.standard_normal(N) if white is None else white(rng)
    return gmwm.Signal(1e-3 * (x + np.cumsum(1e-3 * rng.standard_normal(N))), RATE, "rad/s", "gyro_x")


def measured(data, options):
    """The curve to fit and the outlier test of the only axis."""
    (axis,) = measure(Recordings.of(data, options), options).axes.values()
    curve = axis.curve(options)
    return curve, axis.verdict(robust=curve.robust)


def student(rng):
    return rng.standard_t(5, N)


def with_spikes(seed=1):
    x = signal(seed).values.copy()
    x[50::250] += 0.02
    return gmwm.Signal(x, RATE, "rad/s", "gyro_x")


def with_knocks(seed=1):
    x = signal(seed).values.copy()
    for start in range(3_000, N, 9_000):
        x[start : start + 60] += 0.03 * np.random.default_rng(start).standard_normal(60)
    return gmwm.Signal(x, RATE, "rad/s", "gyro_x")


@pytest.mark.slow
def test_heavy_tails_keep_the_classical_curve_with_their_covariance():
    found = gmwm.calibrate(signal(white=student), WITHIN)
    wv, verdict = found["gyro_x"].wavelet_variance, found.verdicts["gyro_x"]
    assert verdict.exceeds
    assert verdict.heavy_tailed
    assert not verdict.contaminated
    assert not wv.robust
    assert wv.excess is not None
    assert 2.0 < N * wv.excess[0, 0] < 12.0
    assert "heavy-tails:fit" in codes(found.remarks)
    assert codes(verdict.remarks) == ["heavy-tails:test"]
    assert "left out" not in found.summary()


def test_gaussian_noise_has_no_remark_and_no_excess():
    wv, verdict = measured(signal(), CalibrationOptions())
    assert not wv.robust
    assert wv.excess is None
    assert (verdict.replaced, verdict.spikes, verdict.exceeds) == (Replaced(), 0, False)


@pytest.mark.slow
def test_wrong_samples_are_replaced_and_counted():
    found = gmwm.calibrate(with_spikes(), WITHIN)
    remark = only(found.remarks, "samples-replaced:spikes", "gyro_x")
    assert remark.facts["count"] == N // 250
    assert remark.facts["largest"] > 15
    assert not found["gyro_x"].wavelet_variance.robust
    clean = gmwm.calibrate(signal(), WITHIN)["gyro_x"].parameters["WN.sigma2"]
    assert found["gyro_x"].parameters["WN.sigma2"] == pytest.approx(clean, rel=0.005)
    assert gmwm.Calibration.from_dict(found.to_dict()).to_dict() == found.to_dict()


@pytest.mark.slow
def test_wrong_samples_are_replaced_whatever_curve_is_wanted():
    for robust in (True, False):
        wv, verdict = measured(with_spikes(), CalibrationOptions(robust=robust))
        assert wv.robust is robust
        assert verdict.replaced.spikes == N // 250


@pytest.mark.slow
def test_the_rule_is_the_same_in_a_stream(tmp_path, monkeypatch):
    monkeypatch.setattr(batches, "BATCH_SAMPLES", 20_000)
    made_of = {"knocks": with_knocks(), "tails": signal(white=student), "spikes": with_spikes()}
    for name, made in made_of.items():
        path = tmp_path / f"{name}.csv"
        gmwm.Imu.from_arrays({"gyro_x": made.values}, RATE).write(path)
        whole = gmwm.calibrate(gmwm.read(path), WITHIN)
        chunks = gmwm.calibrate(gmwm.stream(path, chunk=7_000), WITHIN)
        assert whole.to_dict()["axes"] == chunks.to_dict()["axes"]
        assert not whole["gyro_x"].wavelet_variance.robust
        replaced = {"knocks": "samples-replaced:knocks", "spikes": "samples-replaced:spikes"}
        assert [name for name, code in replaced.items() if code in codes(chunks.remarks)] == [name] * (name != "tails")
        if name == "spikes":
            assert only(chunks.remarks, "samples-replaced:spikes", "gyro_x").facts["count"] == N // 250


@pytest.mark.slow
def test_a_robust_curve_that_depends_on_its_efficiency_gets_a_remark():
    x = signal().values.copy()
    rng = np.random.default_rng(5)
    for start in rng.integers(0, N - 40, 1000):
        x[start : start + 20] += 0.03 * rng.standard_normal(20)
    found = gmwm.calibrate(gmwm.Signal(x, RATE, "rad/s", "gyro_x"), WITHIN)
    facts = only(found.remarks, "robust-depends-on-efficiency:far", "gyro_x").facts
    assert (facts["efficiency"], facts["other"]) == (0.6, 0.9)
    assert facts["value"] != facts["other_value"]
    assert gmwm.Calibration.from_dict(found.to_dict()).to_dict() == found.to_dict()


def test_a_pair_of_curves_is_judged_without_the_samples():
    tailed = signal(white=student)
    curves = gmwm.wavelet_variance(tailed), gmwm.wavelet_variance(tailed, robust=True)
    assert measured({"gyro_x": curves}, CalibrationOptions())[0].robust
    assert not measured(tailed, CalibrationOptions())[0].robust


@pytest.mark.slow
@pytest.mark.parametrize(("seconds", "replaced"), [(6, True), (20, False), (80, False)])
def test_motion_is_replaced_if_it_is_short_and_left_out_otherwise(seconds, replaced):
    x, size = signal(seed=8).values.copy(), round(seconds * RATE)
    still = gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": x}, rate=RATE), WITHIN)
    x[20_000 : 20_000 + size] += 0.02 * np.sin(0.3 * np.arange(size))
    imu = gmwm.Imu.from_arrays({"gyro_x": x}, rate=RATE)
    assert "recording-moved:moved" in codes(gmwm.inspect(imu).remarks)
    found = gmwm.calibrate(imu, WITHIN)
    assert "recording-moved:moved" not in codes(found.remarks)
    assert ("samples-replaced:knocks" in codes(found.remarks)) is replaced
    assert ("recording-moved:excluded" in codes(found.remarks)) is not replaced
    assert found.number_verdicts["gyro_x"]["N"].usability.value == "use"
    assert found.datasheets["gyro_x"]["N"].value == pytest.approx(still.datasheets["gyro_x"]["N"].value, rel=0.02)
    if replaced:
        ((start, stop),) = found.verdicts["gyro_x"].replaced.knocks
        assert 190 < start < 200 < 206 < stop < 220
    else:
        ((begin, end),) = only(found.remarks, "recording-moved:excluded", "gyro_x").facts["ranges"]
        assert 185 <= begin < 200 < 200 + seconds < end <= 215 + seconds
        kept = gmwm.calibrate(imu, WITHIN, repeated="keep")
        assert kept.number_verdicts["gyro_x"]["N"].usability.value == "do not use"
        assert "recording-moved:moved" in codes(kept.remarks)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_motion_is_left_out_if_it_is_replaced_on_one_axis_only(seed):
    """Handling at both ends. A knock that is replaced on gyro_y does not remove the motion of gyro_x."""
    rng = np.random.default_rng(seed)
    x = 1e-3 * rng.normal(size=(2, 30_000))
    for part in (slice(1000), slice(29_000, None)):
        x[:, part] += np.cumsum(0.01 * rng.normal(size=(2, 1000)), axis=1)
    found = gmwm.calibrate(gmwm.Imu.from_arrays({"gyro_x": x[0], "gyro_y": x[1]}, rate=50.0), "WN + RW")
    assert "recording-moved:moved" not in codes(found.remarks)
    for axis, sheet in found.datasheets.items():
        assert found.number_verdicts[axis]["N"].usability.value == "use"
        assert sheet["N"].value == pytest.approx(1e-3 / 50**0.5, rel=0.02)
