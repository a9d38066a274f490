"""Clipping, counters, jumps and swings of the mean are found and named, and clean noise is not."""

import math

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import Signal
from gmwm.measuring.inspection import inspect
from gmwm.measuring.inspection.time_grid import Extent, _loss
from gmwm.measuring.inspection.trends import swing_of
from gmwm.measuring.inspection.wander import Likelihood
from gmwm.recording.signals import Imu
from tests.helpers import code_of, codes, only
from validation import faults

RATE, SAMPLES = 100.0, 60_000


def seen(x):
    return inspect(imu_of(x))


def named(x):
    return set(codes(seen(x).remarks))


def imu_of(x):
    return Imu({"gyro_x": Signal(x, RATE, "rad/s", axis="gyro_x")})


NAMED = {
    "output-clipped:noise", "output-clipped:rare", "output-clipped:inside", "output-clipped:folded",
    "output-rounded:counter",
    "level-steps:clear", "level-steps:possible", "trend:swing", "fault-undone:held", "fault-undone:repeated",
    "fault-undone:frozen", "fault-undone:interpolated", "fault-undone:dead", "fault-undone:wrapped",
    "heavy-tails:changes",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", faults.CLEAN)
def test_a_clean_recording_has_no_fault(kind):
    for seed in range(2):
        assert not NAMED & named(faults.CLEAN[kind](SAMPLES, np.random.default_rng(seed)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["clipped", "clipped_both", "full_scale"])
def test_clipping_is_found_with_its_share(kind):
    for seed in range(3):
        x = faults.FAULTS[kind](SAMPLES, np.random.default_rng(seed))
        remark = only(seen(x).remarks, "output-clipped:noise", "gyro_x")
        at_ends = np.count_nonzero(x == x.max()) + (np.count_nonzero(x == x.min()) if kind == "clipped_both" else 0)
        assert remark.facts["share"] == pytest.approx(100 * at_ends / x.size, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("step", [0.0, 0.01, 0.3])
def test_clipping_is_the_only_fault_of_a_clipped_output_at_any_resolution(share, step):
    rng = np.random.default_rng(4)
    x = rng.standard_normal(SAMPLES) + np.cumsum(0.002 * rng.standard_normal(SAMPLES))
    x = np.minimum(x, np.quantile(x, 1 - share))
    found = named((np.round(x / step) * step if step else x) * 1e-3)
    assert "output-clipped:noise" in found
    assert not {"coarse-output", "knocks"} & found


@pytest.mark.parametrize(("share", "case"), [(0.002, "rare"), (0.02, "noise")])
def test_few_clipped_samples_leave_the_numbers_usable(share, case):
    rng = np.random.default_rng(5)
    x = 1e-3 * (rng.standard_normal(SAMPLES) + np.cumsum(0.01 * rng.standard_normal(SAMPLES)))
    calibration = gmwm.calibrate(imu_of(np.minimum(x, np.quantile(x, 1 - share))), "WN + RW")
    only(calibration.remarks, f"output-clipped:{case}", "gyro_x")
    uses = {calibration.number_verdicts["gyro_x"][symbol].usability.value for symbol in ("N", "K")}
    assert uses == {"use" if case == "rare" else "do not use"}


def test_the_loss_of_clipped_gaussian_noise_is_that_of_the_samples():
    z = np.random.default_rng(6).standard_normal(1_000_000)
    for low, high in ((-9.0, 2.0), (-1.0, 0.0)):
        shares = [float(np.mean(z >= high)), float(np.mean(z <= low))]
        loss = _loss([share for share in shares if share])
        assert loss == pytest.approx(1 - np.std(np.clip(z, low, high)), abs=2e-3)


@pytest.mark.parametrize("step", [0.0, 0.1, 0.3])
def test_a_dead_band_is_found(step):
    x = np.random.default_rng(7).normal(0.3, 1.0, SAMPLES)
    x = np.round(x / step) * step if step else x
    remark = only(seen(1e-3 * np.where(abs(x) < 1.0, 0.0, x)).remarks, "output-clipped:inside", "gyro_x")
    assert remark.facts["share"] == pytest.approx(100 * np.mean(abs(x) < 1.0), rel=0.05)
    assert remark.facts["value"].value == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize(("step", "memory"), [(0.1, 0.0), (0.1, 0.7), (0.6, 0.0), (0.6, 0.7), (1.0, 0.5), (1.7, 0.0)])
def test_truncation_towards_zero_is_found_only_around_zero(step, memory):
    x = lfilter([math.sqrt(1 - memory**2)], [1, -memory], np.random.default_rng(7).standard_normal(SAMPLES))
    assert "output-clipped:inside" in named(1e-3 * np.trunc((x + 0.3) / step) * step)
    assert "output-clipped:inside" not in named(1e-3 * np.trunc((x + 9.0) / step) * step)
    verdicts = gmwm.calibrate(imu_of(1e-3 * np.trunc(x / step) * step), "WN + RW").number_verdicts["gyro_x"]
    assert verdicts["N"].usability.value == "do not use"


@pytest.mark.parametrize("step", [0.0, 0.01, 0.05])
def test_an_absolute_value_is_found(step):
    rng = np.random.default_rng(11)
    white, smooth = rng.standard_normal(SAMPLES), lfilter([0.3], [1, -0.95], rng.standard_normal(SAMPLES))
    for x, folded in ((white, True), (smooth, True), (white + 1, True), (white + 2, False)):
        x = np.round(x / step) * step if step else x
        for sign in (-1e-3, 1e-3):
            assert ("output-clipped:folded" in named(sign * np.abs(x))) == folded
        assert "output-clipped:folded" not in named(1e-3 * x)
    for other in (np.hypot(white, smooth), np.abs(white) + 0.3, 1e-4 * np.arange(SAMPLES) + np.abs(white), white + 6,
                  np.maximum(white, 0)):  # fmt: skip
        assert "output-clipped:folded" not in named(1e-3 * other)
    verdicts = gmwm.calibrate(imu_of(1e-3 * np.abs(white)), "WN + RW").number_verdicts["gyro_x"]
    assert verdicts["N"].usability.value == "do not use"


@pytest.mark.parametrize(
    ("mean", "share", "code"),
    [(50.0, 0.2, "output-clipped:noise"), (-50.0, 0.2, "output-clipped:noise"), (0.5, 0.08, "output-clipped:inside")],
)
def test_failed_readings_that_are_not_replaced_spoil_an_axis(mean, share, code):
    rng = np.random.default_rng(9)
    x = 1e-3 * rng.normal(mean, 1.0, SAMPLES) * (rng.random(SAMPLES) > share)
    assert code in named(x)
    assert gmwm.calibrate(imu_of(x), "WN + RW").number_verdicts["gyro_x"]["N"].usability.value == "do not use"


@pytest.mark.parametrize("kind", ["t4", "laplace", "walk", "line", "twice", "zeros", "far_zeros"])
def test_other_noise_has_no_dead_band(kind):
    rng = np.random.default_rng(8)
    noise = {
        "t4": lambda: rng.standard_t(4, SAMPLES), "laplace": lambda: rng.laplace(size=SAMPLES),
        "walk": lambda: 0.3 * rng.standard_normal(SAMPLES) + np.cumsum(0.02 * rng.standard_normal(SAMPLES)),
        "line": lambda: rng.standard_normal(SAMPLES) + 5 * np.sin(0.3 * np.arange(SAMPLES)),
        "twice": lambda: np.round(rng.standard_normal(SAMPLES) / 0.07) * 0.07,
        "zeros": lambda: rng.normal(0.5, 1.0, SAMPLES) * (rng.random(SAMPLES) > 0.005),
        "far_zeros": lambda: rng.normal(50.0, 1.0, SAMPLES) * (rng.random(SAMPLES) > 0.005),
    }[kind]()  # fmt: skip
    for step in (1e-9, 0.1, 0.25, 1.0):
        found = named(1e-3 * np.round(noise / step) * step)
        assert not {"output-clipped:noise", "output-clipped:inside"} & found


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.3, 1.0, 2.0, 3.0])
@pytest.mark.parametrize("place", [0.0, 0.25, 0.5])
def test_a_coarse_output_is_not_clipped(ratio, place):
    x = np.random.default_rng(3).normal(place * ratio, 1.0, 200_000)
    assert not named(np.round(x / ratio) * ratio * 1e-3) & {"output-clipped:noise", "output-clipped:rare"}


def test_numbers_of_a_clipped_axis_are_not_used():
    x = faults.clipped_both(SAMPLES, np.random.default_rng(1))
    verdicts = gmwm.calibrate(imu_of(x), "WN + RW").number_verdicts["gyro_x"]
    assert {verdicts[symbol].usability.value for symbol in ("N", "K")} == {"do not use"}


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["counter", "counter_exact"])
def test_a_counter_is_named_and_keeps_its_numbers(kind):
    x = faults.FAULTS[kind](SAMPLES, np.random.default_rng(2))
    found = named(x)
    assert "output-rounded:counter" in found
    assert not {"coarse-output", "output-clipped:noise", "level-steps:clear", "level-steps:possible", "knocks"} & found
    calibration = gmwm.calibrate(imu_of(x), "WN + QN + RW")
    assert calibration.axes["gyro_x"].verdict.replaced.spikes == 0
    assert calibration.number_verdicts["gyro_x"]["N"].usability.value == "use"


@pytest.mark.slow
def test_a_small_jump_is_found_and_subtracted():
    rng = np.random.default_rng(4)
    x = faults.WHITE * rng.normal(size=2 * SAMPLES) + 2e-4 * (np.arange(2 * SAMPLES) > 70_000)
    (step,) = seen(x).steps
    assert step.time == pytest.approx(700, abs=10)
    assert step.size == pytest.approx(2e-4, rel=0.2)
    calibration = gmwm.calibrate(imu_of(x), "WN + RW")
    remark = only(calibration.remarks, "fault-undone:jumps", "gyro_x")
    assert remark.facts["count"] == 1
    kept = gmwm.calibrate(imu_of(x), "WN + RW", repeated="keep")
    without, with_jump = (result.datasheets["gyro_x"]["K"] for result in (calibration, kept))
    assert without.upper_only
    assert with_jump.high > 2 * without.high


@pytest.mark.slow
def test_several_jumps_are_told_from_a_random_walk():
    """One by one, each of several jumps looks like a part of a random walk of the others."""
    several = 0
    for seed in range(6):
        rng = np.random.default_rng(seed)
        at = np.sort(rng.integers(2_000, SAMPLES - 2_000, size=5))
        sizes = 2.4e-4 * rng.choice([-1, 1], size=5) * rng.uniform(0.7, 1.5, size=5)
        x = faults.WHITE * rng.normal(size=SAMPLES)
        x += sizes @ (np.arange(SAMPLES) > at[:, None])
        remarks = [remark for remark in seen(x).remarks if remark.code == "level-steps"]
        several += bool(remarks) and remarks[0].facts["count"] >= 2
    assert several >= 5


@pytest.mark.slow
@pytest.mark.parametrize(("sizes", "recurs"), [((1, 0.8), False), ((1, -1, 1, -1), False), ((1, 0.8, -2.2, 0.9), True)])
def test_jumps_of_more_than_two_changes_are_noise_of_the_sensor(sizes, recurs):
    """A filter meets such jumps in use too: the limit of K without them was 3 to 15 times too small."""
    jumps = 4e-4 * np.array(sizes)
    places = SAMPLES * (np.arange(jumps.size) + 0.7) / (jumps.size + 0.5)
    x = faults.WHITE * np.random.default_rng(3).normal(size=SAMPLES) + jumps @ (np.arange(SAMPLES) > places[:, None])
    steps = seen(x).steps
    assert len(steps) == jumps.size
    assert [step.is_certain for step in steps] == [not recurs] * jumps.size
    walk = gmwm.calibrate(imu_of(x), "WN + RW").datasheets["gyro_x"]["K"]
    assert walk.upper_only
    assert (walk.high > np.sqrt(np.sum(jumps**2) * RATE / SAMPLES)) == recurs


@pytest.mark.slow
def test_a_jump_is_subtracted_from_a_stream_too(tmp_path):
    rng = np.random.default_rng(4)
    x = faults.WHITE * rng.normal(size=2 * SAMPLES) + 2e-4 * (np.arange(2 * SAMPLES) > 70_000)
    imu_of(x).write(tmp_path / "log.csv")
    from_file, streamed = (
        gmwm.calibrate(source(tmp_path / "log.csv"), "WN + RW").to_dict() for source in (gmwm.read, gmwm.stream)
    )
    assert from_file == streamed


def test_jumps_that_fit_to_the_random_walk_are_noise():
    rng = np.random.default_rng(5)
    walk = np.cumsum(3e-6 * rng.normal(size=SAMPLES))
    x = faults.WHITE * rng.normal(size=SAMPLES) + walk + 3e-4 * (np.arange(SAMPLES) > 30_000)
    assert not seen(x).steps


@pytest.mark.slow
@pytest.mark.parametrize("periods", [2.5, 4.0, 8.3])
def test_a_swing_of_the_mean_makes_k_a_limit(periods):
    rng = np.random.default_rng(6)
    size = 2 * SAMPLES
    x = faults.WHITE * rng.normal(size=size) + 1e-4 * np.sin(2 * np.pi * periods * np.arange(size) / size + 1)
    calibration = gmwm.calibrate(imu_of(x), "WN + RW")
    remark = only(calibration.remarks, "trend:swing", "gyro_x")
    assert remark.facts["period"].value == pytest.approx(size / RATE / periods, rel=0.15)
    assert calibration.number_verdicts["gyro_x"]["K"].usability.value == "use as a bound"
    assert calibration.number_verdicts["gyro_x"]["N"].usability.value == "use"
    assert calibration.datasheets["gyro_x"]["K"].upper_only


@pytest.mark.slow
@pytest.mark.parametrize(("periods", "share"), [(9.6, 0.25), (8.3, 0.5)])
def test_a_switch_makes_k_a_limit(periods, share):
    """Beside a sinusoid, K still contains the steps: it was 2 to 90 times too large, with the mark "use"."""
    rng, count = np.random.default_rng(11), 2 * SAMPLES
    phase = np.arange(count) / count * periods + 0.13
    found = gmwm.calibrate(imu_of(faults.base(count, rng) + 0.4 * faults.WHITE * (phase % 1 < share)), "WN + GM + RW")
    verdict = found.number_verdicts["gyro_x"]["K"]
    assert (verdict.usability.value, code_of(verdict.reason)) == ("use as a bound", "trend:swing")
    period = only(found.remarks, "trend:swing", "gyro_x").facts["period"].value
    assert period == pytest.approx(count / RATE / periods, rel=0.02)


def test_the_steps_of_a_switch_have_one_period():
    """Beside fewer than nine harmonics, the steps are a walk. A walk itself has no period."""
    rng, time = np.random.default_rng(12), np.arange(256)
    for k in range(40):
        walk = rng.normal(size=256) + 10 ** rng.uniform(-2, 1) * np.cumsum(rng.normal(size=256))
        switch = 0.1 * rng.normal(size=256) + (time * 4.05 / 256 % 1 < 0.5)
        for y, periods in ((walk, None), (switch, pytest.approx(4.05, abs=0.06))):
            found = swing_of("gyro_x", [(0, y)], Extent(100.0, ((0, 25_600),), (0.0,)), lambda a, b: np.zeros(b - a))
            assert (found and found.periods) == periods, k


@pytest.mark.slow
@pytest.mark.parametrize("period", [15.0, 25.0, 60.0])
def test_the_cycle_of_a_heater_is_a_swing(period):
    """Each period differs by 5 % from the others, so that no sinusoid fits them."""
    rng, size = np.random.default_rng(8), 2 * SAMPLES
    ends = np.cumsum(period * (1 + 0.05 * rng.normal(size=200)))
    time = np.arange(size) / RATE
    phase = np.interp(time, ends, np.arange(200.0)) % 1.0
    calibration = gmwm.calibrate(imu_of(faults.base(size, rng) + 4e-4 * np.abs(2 * phase - 1)), "WN + GM + RW")
    remark = only(calibration.remarks, "trend:swing", "gyro_x")
    assert remark.facts["period"].value == pytest.approx(period, rel=0.1)
    assert calibration.number_verdicts["gyro_x"]["K"].usability.value != "use"


@pytest.mark.parametrize("frequency", [0.83, 1.25, 4.55])
def test_a_vibration_is_no_swing_of_its_alias(frequency):
    rng, size = np.random.default_rng(9), 2 * SAMPLES
    line = 2e-3 * np.sin(2 * np.pi * frequency * np.arange(size) / RATE)
    x = faults.base(size, rng) + line
    length = size // 256
    means = x[: 256 * length].reshape(256, length).mean(axis=1)
    assert Likelihood(means).best_band(4)[0] > 20.0
    assert "trend:swing" not in named(x)


def test_noise_with_two_levels_gets_the_classical_curve():
    x = faults.telegraph(2 * SAMPLES, np.random.default_rng(1))
    calibration = gmwm.calibrate(imu_of(x))
    assert not calibration["gyro_x"].wavelet_variance.robust
    assert "GM" in calibration["gyro_x"].model.structure
    assert "heavy-tails:levels" in codes(calibration.remarks)


@pytest.mark.slow
def test_small_outliers_in_quantization_noise_make_n_a_limit():
    x = faults.outliers_in_quantization(2 * SAMPLES, np.random.default_rng(1))
    calibration = gmwm.calibrate(imu_of(x), "WN + QN + RW")
    assert only(calibration.remarks, "outliers-found:small").facts["share"] > 2
    verdicts = calibration.number_verdicts["gyro_x"]
    assert (verdicts["N"].usability.value, verdicts["Q"].usability.value) == ("use as a bound", "use")
    assert verdicts["N"].reason.code == "outliers-found"
    white = calibration.datasheets["gyro_x"]["N"]
    assert white.upper_only
    assert faults.WHITE / RATE**0.5 < white.value < white.high
    assert f"≤ {white.in_units()[2]:.3g}" in calibration.summary()
    assert f"≤ {white.in_units()[2]:.3g}" in calibration.summary(details=True)
    both = calibration.combined(
        gmwm.calibrate(gmwm.simulate({"accel_x": "WN(sigma2=4e-6)"}, rate=RATE, samples=SAMPLES, rng=1), "WN")
    )
    for horizon in (1.0, 10.0):
        lines = both.export(horizon=horizon).splitlines()
        assert next(line for line in lines if "gyroscope_noise_density" in line).endswith("upper limit")
    assert gmwm.Calibration.from_dict(calibration.to_dict()).number_verdicts == calibration.number_verdicts


@pytest.mark.slow
@pytest.mark.parametrize("size", [12.0, 50.0])
def test_large_wrong_samples_leave_no_small_ones(size):
    rng = np.random.default_rng(3)
    x = faults.WHITE * rng.normal(size=SAMPLES)
    x[rng.choice(SAMPLES, 60, replace=False)] += size * faults.WHITE
    calibration = gmwm.calibrate(imu_of(x), "WN")
    assert only(calibration.remarks, "samples-replaced:spikes").facts["count"] == 60
    assert calibration.number_verdicts["gyro_x"]["N"].usability.value == "use"
    white = calibration.datasheets["gyro_x"]["N"]
    assert white.low < faults.WHITE / RATE**0.5 < white.high


@pytest.mark.slow
def test_tails_of_three_degrees_of_freedom_stay_in():
    for seed in range(3):
        x = faults.student(3.0)(SAMPLES, np.random.default_rng(seed))
        replaced = gmwm.calibrate(imu_of(x), "WN + RW").axes["gyro_x"].verdict.replaced
        assert not replaced.knocks


@pytest.mark.slow
def test_a_dither_line_is_not_a_wrong_unit():
    x = faults.dithered(2 * SAMPLES, np.random.default_rng(3))
    calibration = gmwm.calibrate(imu_of(x))
    assert "unit-doubtful:density" not in codes(calibration.remarks)
    entry = calibration.datasheets["gyro_x"]["N"]
    assert entry.low < faults.WHITE / np.sqrt(RATE) < entry.high * 1.01


@pytest.mark.parametrize("rate", [1e-4, 1e-3, 0.1])
def test_slow_recordings_are_calibrated(rate):
    x = np.random.default_rng(1).normal(0, 1e-6, 5_000)
    calibration = gmwm.calibrate(Signal(x, rate, "rad/s", axis="gyro_x"), "WN + RW")
    assert calibration.datasheets["gyro_x"]["N"].value == pytest.approx(1e-6 / np.sqrt(rate), rel=0.05)


@pytest.mark.slow
def test_jumps_that_a_walk_hardly_explains_make_k_a_bound():
    x = faults.jumps_in_walk(120_000, np.random.default_rng(2))
    inspection = seen(x)
    remark = only(inspection.remarks, "level-steps:possible", "gyro_x")
    assert all(step.possible for step in inspection.steps)
    assert remark.facts["count"] == len(inspection.steps)
    calibration = gmwm.calibrate(imu_of(x), "WN + RW")
    verdict = calibration.number_verdicts["gyro_x"]["K"]
    assert verdict.usability.value == "use as a bound"
    assert not any(remark.facts.get("case") == "jumps" for remark in calibration.remarks)


@pytest.mark.parametrize("seconds", [2, 5, 40])
def test_a_disturbance_of_some_seconds_is_a_jump_and_a_jump_back(seconds):
    """Its ends are found to within samples, so that N is right, also if it is shorter than a block of the search."""
    rng, length = np.random.default_rng(seconds), 100 * seconds
    x = faults.WHITE * rng.normal(size=SAMPLES) + np.cumsum(faults.WALK * rng.normal(size=SAMPLES))
    begins = (SAMPLES // 5 + 37, SAMPLES // 2 + 111)
    for begin in begins:
        x[begin : begin + length] += 2.0 * faults.WHITE
    steps = [step for step in seen(x).steps if step.is_certain]
    assert [step.index for step in steps] == pytest.approx([k for a in begins for k in (a, a + length)], abs=20)
    assert [step.size for step in steps] == pytest.approx([2 * faults.WHITE, -2 * faults.WHITE] * 2, rel=0.2)


def test_noise_has_no_disturbances():
    rng, size = np.random.default_rng(8), 60_000
    for k in range(12):
        walk = np.cumsum(rng.normal(size=size)) * np.exp(rng.uniform(-8, -3))
        noise = rng.standard_t(3, size=size) if k % 2 else rng.normal(size=size)
        assert not any(step.is_certain for step in seen(1e-4 * (noise + walk)).steps), k


@pytest.mark.parametrize("seed", [4, 6])
def test_several_jumps_that_look_like_a_walk_are_possible(seed):
    x = faults.jumps(120_000, np.random.default_rng((5, seed)))
    remark = only(seen(x).remarks, "level-steps:possible", "gyro_x")
    assert len(remark.facts["places"]) == remark.facts["count"] >= 2


def test_a_second_warm_up_makes_k_a_bound():
    """After a power cycle, the mean jumps and decays again. A jump that is subtracted would leave the decay in K."""
    size = 3 * SAMPLES
    at = np.arange(size) / size
    x = faults.WHITE * np.random.default_rng(3).normal(size=size)
    x += 4e-4 * np.exp(-8 * at) + 4e-4 * np.where(at > 0.5, np.exp(-8 * (at - 0.5)), 0.0)
    ((first, last),) = only(seen(x).remarks, "level-steps:settles", "gyro_x").facts["ranges"]
    assert first == pytest.approx(size / 2 / faults.RATE, rel=0.02)
    assert last > 0.7 * size / faults.RATE
    calibration = gmwm.calibrate(imu_of(x), "WN + RW")
    assert calibration.number_verdicts["gyro_x"]["K"].usability.value == "use as a bound"
    assert calibration.number_verdicts["gyro_x"]["N"].usability.value == "use"


@pytest.mark.parametrize("shape", ["back", "lasting", "logarithm"])
def test_a_creep_without_a_clear_jump_makes_k_a_bound(shape):
    rng, size = np.random.default_rng(12), 72_000
    x = 1e-4 * np.sqrt(20) * rng.normal(size=size) + np.cumsum(1e-5 / np.sqrt(20) * rng.normal(size=size))
    since = np.maximum(np.arange(size) / 20 - 1500, 0.0)
    course = {"back": (since > 0) * np.exp(-since / 40), "lasting": 1 - np.exp(-since / 60),
              "logarithm": np.log1p(since / 10) / 4}[shape]  # fmt: skip
    recording = Imu({"gyro_x": Signal(x + 1.2e-3 * course, 20.0, "rad/s", axis="gyro_x")})
    calibration = gmwm.calibrate(recording, "WN + RW")
    begin, end = only(calibration.remarks, "level-steps:settles", "gyro_x").facts["ranges"][0]
    assert 1400 < begin < 1520 < end
    assert calibration.number_verdicts["gyro_x"]["K"].usability.value == "use as a bound"


@pytest.mark.slow
def test_a_settling_is_no_staircase_of_jumps():
    """Subtracted jumps leave a part of a creep in K: without the bound, K of such axes was 2.7 times too large."""
    rng, size, begin = np.random.default_rng(1018), 240_000, 140_000
    since = np.arange(size) - begin
    x = 0.01 * rng.normal(size=size) + np.cumsum(5e-6 * rng.normal(size=size))
    x += np.where(since > 0, 0.01 * np.exp(-np.maximum(since, 0) / 2500), 0.0)
    recording = Imu({"accel_x": Signal(x, 100.0, "m/s²", axis="accel_x")})
    calibration = gmwm.calibrate(recording, "WN + RW")
    remark = only(calibration.remarks, "level-steps:settles", "accel_x")
    ((first, last),) = remark.facts["ranges"]
    assert 1380 < first < 1401
    assert 1450 < last < 1700
    assert not any(remark.facts.get("case") == "jumps" for remark in calibration.remarks)
    assert calibration.number_verdicts["accel_x"]["K"].usability.value == "use as a bound"


@pytest.mark.slow
def test_jumps_without_a_decay_are_no_settling():
    rng = np.random.default_rng(4)
    settling = 0
    for count in (1, 2, 3, 4) * 3:
        x = 0.01 * rng.normal(size=120_000) + np.cumsum(5e-6 * rng.normal(size=120_000))
        for place in rng.integers(10_000, 110_000, count):
            x[place:] += rng.choice([-1, 1]) * rng.uniform(0.005, 0.02)
        steps = gmwm.inspect(Imu({"accel_x": Signal(x, 100.0, "m/s²", axis="accel_x")})).steps
        settling += any(step.until is not None for step in steps)
    assert settling == 0


@pytest.mark.slow
def test_a_day_with_harmonics_is_a_part_of_the_model():
    rng, rate = np.random.default_rng(8), 0.25
    time = np.arange(int(4 * 86_400 * rate)) / rate
    x = 1e-5 * rng.normal(size=time.size)
    x += sum(size * np.sin(2 * np.pi * k * time / 86_400 + k) for k, size in ((1, 4e-6), (2, 1.5e-6)))
    calibration = gmwm.calibrate(Imu({"gyro_x": Signal(x, rate, "rad/s", axis="gyro_x")}))
    processes = calibration.axes["gyro_x"].fit.model.processes
    periods = [1 / process.line(rate)[1] / rate for process in processes if process.name == "SIN"]
    assert any(period == pytest.approx(86_400) for period in periods)
    assert any(period == pytest.approx(43_200) for period in periods)
    assert not any(remark.facts.get("case") == "swing" for remark in calibration.remarks)
    number = calibration.datasheets["gyro_x"]["N"]
    assert number.low < 1e-5 / rate**0.5 < number.high
    assert number.high < 1.05 * number.low


@pytest.mark.parametrize(("ratio", "changes"), [(1.3, True), (1.1, False)])
def test_a_level_of_the_noise_that_changes_is_named_with_its_time(ratio, changes):
    """Two logs joined, another range, or axes swapped: N is a mean of both."""
    rng = np.random.default_rng(11)
    x = faults.base(SAMPLES, rng)
    x[SAMPLES // 3 :] += np.sqrt(ratio**2 - 1) * faults.WHITE * rng.normal(size=SAMPLES - SAMPLES // 3)
    remarks = seen(x).remarks
    assert ("heavy-tails:changes" in codes(remarks)) == changes
    if changes:
        remark = only(remarks, "heavy-tails:changes", "gyro_x")
        assert remark.facts["share"] == pytest.approx(100 * (ratio - 1), rel=0.3)
        assert remark.facts["time"].value == pytest.approx(SAMPLES / RATE / 3, rel=0.1)


@pytest.mark.slow
def test_a_level_that_varies_at_random_does_not_change():
    """As the sample variances of heavy tails do."""
    for seed in range(20):
        rng = np.random.default_rng((12, seed))
        x = rng.normal(size=SAMPLES) * np.repeat(np.exp(0.2 * rng.normal(size=64)), SAMPLES // 64 + 1)[:SAMPLES]
        assert "heavy-tails:changes" not in codes(seen(x * faults.WHITE).remarks)


def test_a_clipped_output_has_no_jumps():
    """Minus a jump, it would not look clipped: N of 20 of 100 such recordings could be used, 36 % too small."""
    x = np.random.default_rng(2).normal(size=SAMPLES)
    x[20_000:] += 3.0
    steps = seen(1e-3 * np.minimum(x, 3.5)).steps
    assert not steps
