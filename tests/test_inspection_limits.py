"""The limits of the inspection: a value just below a limit has no effect, and a value just above it has one.

Each case lies within 40 % of its limit, so that half of the limit or its double fails a test.
"""

import numpy as np
import pytest

from gmwm.base.time_base import TimeBase
from gmwm.base.units import AXES, STANDARD_GRAVITY
from gmwm.measuring.inspection import inspect
from gmwm.measuring.inspection.axis_statistics import AxisStatistics, Motion
from gmwm.measuring.inspection.findings import of_gravity, of_motion, of_rounding, of_time, of_trends, of_units
from gmwm.measuring.inspection.knocks import knocks_of, level_length, steps_of
from gmwm.measuring.inspection.result import AxisInspection
from gmwm.measuring.inspection.time_grid import Extent
from gmwm.measuring.inspection.trends import Trend
from gmwm.recording.signals import Imu, Signal
from tests.helpers import codes, only

RATE, SAMPLES = 100.0, 64_000
STILL = Motion(spans=(), ratios={}, still=np.ones(64, dtype=bool))
EXTENT = Extent(RATE, ((0, SAMPLES),), (0.0,))
ALTERNATING = np.tile([1.0, -1.0], SAMPLES // 2)


def rounding(ratio):
    axis = AxisInspection(
        unit="rad/s", mean=0.0, sd=1.0, rest=0.0, noise=1.0, lsb=ratio, before_rounding=1.0, wander=0.0
    )
    return of_rounding({"gyro_x": axis}, RATE)


def warm_up(share, raised=2.0):
    trend = Trend(
        axis="gyro_x", kind="exponential", size=1.0, tau=1.0, pvalue=0.0, until=share * SAMPLES / RATE, walk=1.0,
        walk_limit=1.0, walk_with_trend=raised,
    )  # fmt: skip
    (remark,) = of_trends((trend,), {"gyro_x": "rad/s"}, EXTENT, cut=False)
    return remark.facts.get("way", remark.facts["case"])


def repeated(count, same):
    return codes(of_time(Extent(RATE, ((0, 100_000),), (0.0,)), TimeBase(RATE, duplicates=count), same))


@pytest.mark.parametrize(
    ("remarks", "expected"),
    [
        (lambda: of_gravity(1.015 * STANDARD_GRAVITY, {}), []),
        (lambda: of_gravity(1.025 * STANDARD_GRAVITY, {}), ["unit-contradicted:gravity"]),
        (lambda: of_gravity(1.045 * STANDARD_GRAVITY, {}), ["unit-contradicted:gravity"]),
        (lambda: of_gravity(0.86 * STANDARD_GRAVITY, {}), ["unit-contradicted:gravity"]),
        (lambda: of_gravity(1.16 * STANDARD_GRAVITY, {}), ["unit-doubtful:gravity"]),
        (lambda: of_time(EXTENT, TimeBase(RATE, jitter=0.08 / RATE), 0), []),
        (lambda: of_time(EXTENT, TimeBase(RATE, jitter=0.12 / RATE), 0), ["stamps-irregular:jitter"]),
        (lambda: of_motion(STILL, 0.8, (), EXTENT), ["recording-settles"]),
        (lambda: of_motion(STILL, 1.2, (), EXTENT), ["recording-moved:tilted"]),
        (lambda: of_units({"gyro_x": np.radians(0.08)}), []),
        (lambda: of_units({"gyro_x": np.radians(0.12)}), ["unit-doubtful:density"]),
        (lambda: rounding(0.6), []),
        (lambda: rounding(0.8), ["output-rounded:rounded"]),
        (lambda: rounding(1.7), ["output-rounded:rounded"]),
        (lambda: rounding(2.3), ["coarse-output"]),
    ],
)
def test_remarks_begin_at_their_limits(remarks, expected):
    assert codes(remarks()) == expected


def test_a_warm_up_may_take_half_of_a_recording():
    assert [warm_up(share) for share in (0.4, 0.6)] == ["start", "late"]


def test_a_warm_up_that_hardly_changes_k_is_information():
    assert [warm_up(0.1, raised) for raised in (1.04, 1.07)] == ["small", "start"]


def test_rows_are_written_twice_if_the_samples_repeat_too():
    assert repeated(1000, 920) == ["rows-repeated"]
    assert repeated(1000, 880) == ["stamps-irregular:repeated"]
    assert repeated(120, 120) == ["rows-repeated"]
    assert repeated(80, 80) == ["stamps-irregular:repeated"]


def test_windows_and_blocks_have_fixed_numbers():
    assert len(EXTENT.windows()) == 64
    assert level_length(256_000) == 1000
    assert level_length(5000) == 100


@pytest.mark.parametrize(("factor", "static"), [(3.2, True), (4.8, False)])
def test_a_restless_window_has_four_times_the_usual_deviation(factor, static):
    values = ALTERNATING.copy()
    values[10_000:11_000] *= factor
    assert inspect(Imu.from_arrays({"gyro_x": values}, RATE)).static is static


@pytest.mark.parametrize(("factor", "end"), [(1.7, 112.0), (2.4, 122.0)])
def test_a_window_beside_a_motion_belongs_to_it_at_twice_the_usual_deviation(factor, end):
    values = ALTERNATING.copy()
    values[10_000:11_000] *= 8.0
    values[11_000:12_000] *= factor
    (remark,) = (r for r in inspect(Imu.from_arrays({"gyro_x": values}, RATE)).remarks if r.code == "recording-moved")
    assert remark.facts["ranges"] == ((98.0, end),)


def test_a_motion_ends_with_the_recording():
    values = ALTERNATING.copy()
    values[-500:] *= 8.0
    remark = only(inspect(Imu.from_arrays({"gyro_x": values}, RATE)).remarks, "recording-moved:moved")
    assert remark.facts["ranges"][0][1] == values.size / RATE


@pytest.mark.parametrize("samples", [64, 100, 130, 200, 300])
def test_a_short_recording_at_rest_is_not_moved(samples):
    for seed in range(8):
        x = np.random.default_rng([seed, samples]).normal(size=(6, samples))
        imu = Imu.from_arrays(dict(zip(AXES, x, strict=True)), rate=100.0)
        assert "recording-moved" not in codes(inspect(imu).remarks)


def test_motion_in_a_short_recording_is_left_out_and_motion_everywhere_has_no_rest_to_use():
    x = np.random.default_rng(1).normal(size=(2, 160))
    x[0, 64:96] *= 20
    remark = only(inspect(Imu.from_arrays({"gyro_x": x[0]}, rate=100.0)).remarks, "recording-moved:moved")
    ((begin, end),) = remark.facts["ranges"]
    assert 0.5 < begin <= 0.64
    assert 0.96 <= end < 1.1
    x = np.random.default_rng(1).normal(size=(3, 6400))
    for axis in range(3):
        x[axis, 2150 * axis : 2150 * (axis + 1)] *= 20
    found = inspect(Imu.from_arrays({f"gyro_{a}": x[k] for k, a in enumerate("xyz")}, rate=100.0)).remarks
    assert {r.facts["case"] for r in found if r.code == "recording-moved"} == {"throughout"}


@pytest.mark.slow
@pytest.mark.parametrize(("share", "expected"), [(0.08, False), (0.13, True)])
def test_an_axis_that_often_changes_can_stick(share, expected):
    changes = np.random.default_rng(1).uniform(size=SAMPLES) < share
    changes[20_000:22_000] = False
    values = np.cumsum(changes) % 2.0
    assert ("axis-stuck" in codes(inspect(Imu.from_arrays({"gyro_x": values}, RATE)).remarks)) is expected


def turned(angle, noise):
    """Remarks on an accelerometer with this noise whose direction changes by an angle (degrees) in one window."""
    lean = np.zeros(SAMPLES)
    lean[30_000:31_000] = STANDARD_GRAVITY * np.tan(np.radians(angle)) * SAMPLES / (SAMPLES - 1000)
    wiggle = noise * ALTERNATING
    axes = {"accel_x": lean + wiggle, "accel_y": wiggle, "accel_z": STANDARD_GRAVITY + wiggle}
    return "recording-settles" in codes(inspect(Imu.from_arrays(axes, RATE)).remarks)


@pytest.mark.slow
def test_a_turn_of_a_tenth_of_a_degree_is_reported():
    assert [turned(angle, 1e-3) for angle in (0.08, 0.13)] == [False, True]


@pytest.mark.slow
def test_a_turn_of_five_standard_errors_is_reported():
    # The standard error of the direction of a window is √6 noise / √1000, here 0.1°.
    noise = np.radians(0.1) * STANDARD_GRAVITY * np.sqrt(1000 / 6)
    assert [turned(angle, noise) for angle in (0.4, 0.65)] == [False, True]


def knocks(values):
    statistics = AxisStatistics(Extent(RATE, ((0, values.size),), (0.0,)), 0.0)
    statistics.update(values)
    return knocks_of({"gyro_x": statistics.outliers()}, EXTENT)


@pytest.mark.parametrize(("size", "count"), [(7.0, 0), (9.5, 1)])
def test_an_outlier_is_eight_standard_deviations_large(size, count):
    values = ALTERNATING.copy()
    values[30_500] = size
    assert len(knocks(values)) == count


@pytest.mark.parametrize(("seconds", "count"), [(0.8, 1), (1.3, 2)])
def test_outliers_within_a_second_are_one_knock(seconds, count):
    values = ALTERNATING.copy()
    values[[30_500, 30_500 + round(seconds * RATE)]] = 50.0
    assert len(knocks(values)) == count


def test_a_local_median_extends_over_a_thousand_samples():
    values = ALTERNATING.copy()
    values[30_050:30_450] += 30.0
    (knock,) = knocks(values)
    assert knock.duration == pytest.approx(3.99)
    values[30_050:30_650] += 30.0  # more than half of the block
    assert sum(one.duration for one in knocks(values)) != pytest.approx(5.99)


def steps(level, resolution, extent=EXTENT, noise=0.0):
    level = np.asarray(level, dtype=np.float64)
    length = level_length(extent.samples)
    samples = np.repeat(level, length) + noise * np.resize([0.5, -0.5], level.size * length)
    return steps_of("gyro_x", [(0, level)], extent, resolution=resolution, values=lambda a, b: samples[a:b])


@pytest.mark.parametrize(("size", "count"), [(3.2, 0), (4.8, 1)])
def test_a_jump_is_eight_standard_deviations_large(size, count):
    # The smallest standard deviation is half the quantization step.
    assert len(steps([0.0] * 40 + [size] * 40, resolution=1.0)) == count


@pytest.mark.parametrize(("size", "count"), [(3.2, 0), (4.8, 1)])
def test_a_jump_is_four_times_as_large_as_the_changes_around_it(size, count):
    level = [0.0] * 40 + [1.0, 1.0 + size / 2] + [1.0 + size] * 40
    assert len(steps(level, resolution=0.1)) == count


@pytest.mark.parametrize(("blocks", "count"), [(33, 0), (36, 1)])
def test_a_jump_needs_32_differences(blocks, count):
    assert len(steps([0.0] * 20 + [9.0] * (blocks - 20), resolution=1.0)) == count


@pytest.mark.parametrize(("distance", "expected"), [(7, True), (11, False)])
def test_a_restart_is_a_jump_near_a_short_gap(distance, expected):
    # The distance may be 1 + 32 (σ/size)² = 9 samples: squared differences of the noise are 1, and the jump is 2.
    start = 10_000 - distance
    extent = Extent(RATE, ((0, start), (start, 20_000)), (0.0, (start + 1) / RATE))
    (step,) = steps([0.0] * 100 + [2.0] * 100, 0.1, extent=extent, noise=1.0)
    assert step.time * RATE == pytest.approx(10_001)
    assert step.at_gap is expected


@pytest.mark.parametrize(("deviation", "named"), [(9.0, False), (60.0, True)])
def test_knocks_that_change_no_number_have_no_remark(deviation, named):
    x = np.random.default_rng(4).normal(size=60_000)
    x[30_000] = deviation
    found = inspect(Imu({"gyro_x": Signal(x, 100.0, "rad/s", axis="gyro_x")}))
    assert (len(found.knocks), found.has_knocks) == (1, named)
    assert ("change N by less than 0.5 %" in found.summary()) is not named


def test_exchanged_columns_are_named_instead_of_motion():
    x = np.random.default_rng(1).normal(scale=1e-3, size=(6, 6400))
    x[2] += STANDARD_GRAVITY
    remarks = inspect(Imu.from_arrays(dict(zip(AXES, x, strict=True)), rate=100.0)).remarks
    assert only(remarks, "unit-doubtful:exchanged").subject == "gyro_z"
    assert not [code for code in codes(remarks) if code.startswith("recording-moved")]
