"""Faults of a logger are found, named and undone, and clean recordings are left as they are."""

import numpy as np
import pytest
from scipy.signal import lfilter

import gmwm
from gmwm import Imu, Signal
from gmwm.recording.repairs import repaired
from gmwm.recording.repairs.patterns import modulus_of, two_levels_of
from gmwm.recording.repairs.repeats import held_by_chance, repeats, repeats_of
from tests.helpers import codes, only

RATE = 100.0


def _noise(seed=0, n=20_000):
    rng = np.random.default_rng(seed)
    return 1e-3 * rng.normal(size=n) + np.cumsum(3e-7 * rng.normal(size=n))


def _imu(values, **more):
    return Imu({axis: Signal(x, RATE, "rad/s", axis=axis) for axis, x in {"gyro_x": values, **more}.items()})


def _codes(recording):
    return set(codes(recording.remarks))


def _low_pass(x, share):
    y = np.empty_like(x)
    level = 0.0
    for k, value in enumerate(x):
        level += share * (value - level)
        y[k] = level
    return y


@pytest.mark.slow
@pytest.mark.parametrize("step", [0.0, 1e-4, 7e-4, 3e-3])
@pytest.mark.parametrize("share", [1.0, 0.3, 0.05])
def test_a_clean_recording_is_not_changed(step, share):
    for seed in range(5):
        x = _low_pass(_noise(seed), share)
        x = np.round(x / step) * step if step else x
        for recording in (_imu(x), _imu(x, gyro_y=_noise(seed + 100))):
            assert repaired(recording) == (recording,)


@pytest.mark.parametrize("k", [2, 3, 4, 7, 10])
@pytest.mark.parametrize("step", [0.0, 8e-4])
def test_values_that_are_held_are_used_once(k, step):
    x = _noise(k, 6_000)
    x = np.round(x / step) * step if step else x
    (part,) = repaired(_imu(np.repeat(x, k)[k // 2 :]))
    assert part.rate == RATE / k
    assert len(part.segments) == 1
    assert np.array_equal(part["gyro_x"].values[1:-1], x[1 : len(part) - 1])
    remark = only(part.remarks, "fault-undone:held")
    assert remark.facts["times"] == k


@pytest.mark.parametrize("ratio", [1.25, 1.5, 2.5])
def test_a_short_log_with_a_regular_pattern_is_held(ratio):
    x = _noise(2, 450)
    held = x[(np.arange(450) / ratio).astype(int)]
    assert repeats_of([held], repeats([held], np.array([0]))).every == pytest.approx(ratio, rel=0.02)
    lost = np.flatnonzero(np.random.default_rng(5).random(450) > 1 / ratio)
    x[lost[lost > 0]] = np.nan
    filled = x[np.maximum.accumulate(np.where(np.isnan(x), 0, np.arange(450)))]
    assert repeats_of([filled], repeats([filled], np.array([0]))).kind == "lost"


def test_a_log_at_another_rate_gives_the_samples_of_the_sensor():
    x = _noise(1, 20_000)
    (part,) = repaired(_imu(x[(np.arange(30_000) * 0.625 + 0.3).astype(int)]))
    assert part.rate == pytest.approx(62.5, rel=1e-3)
    assert np.array_equal(part["gyro_x"].values, x[: len(part)])


def test_sensors_with_different_rates_are_divided():
    values = {f"gyro_{axis}": _noise(k) for k, axis in enumerate("xyz")}
    held = {f"accel_{axis}": np.repeat(_noise(k, 5_000), 4) for k, axis in enumerate("xyz")}
    signals = {axis: Signal(x, RATE, axis=axis) for axis, x in {**values, **held}.items()}
    gyros, accels = repaired(Imu(signals))
    assert (gyros.rate, accels.rate) == (RATE, RATE / 4)
    assert "fault-undone:held" not in _codes(gyros)


def test_samples_that_repeat_the_last_one_are_gaps():
    rng, x = np.random.default_rng(3), _noise(3)
    lost = rng.random(x.size) < 0.03
    lost[0] = False
    (part,) = repaired(_imu(x[np.maximum.accumulate(np.where(lost, 0, np.arange(x.size)))]))
    assert part.rate == RATE
    assert np.array_equal(part["gyro_x"].values, x[~lost])
    assert np.allclose(part["gyro_x"].times() * RATE, np.flatnonzero(~lost), atol=1e-6)
    assert "fault-undone:repeated" in _codes(part)


@pytest.mark.parametrize("step", [0.0, 5e-4])
def test_frozen_samples_are_gaps_and_a_dead_start_is_left_out(step):
    x = _noise(4)
    x = np.round(x / step) * step if step else x
    at = np.arange(x.size)
    frozen = (at % 4000 >= 1000) & (at % 4000 < 1100)
    x = x[np.maximum.accumulate(np.where(frozen, 0, at))]
    x[:900] = 0.0
    (part,) = repaired(_imu(x))
    assert {"fault-undone:dead"} <= _codes(part)
    # The dead start is not counted a second time.
    assert only(part.remarks, "fault-undone:frozen").facts["longest"].value == pytest.approx(1.0, abs=0.05)
    assert part["gyro_x"].start == pytest.approx(9.0, abs=0.02)
    assert len(part) == pytest.approx(x.size - 900 - np.count_nonzero(frozen), abs=20)


@pytest.mark.parametrize(("step", "length"), [(0.0, 5), (0.0, 20), (0.0, 100), (1e-5, 6), (1e-4, 12), (3e-4, 40)])
def test_holds_of_one_axis_are_gaps(step, length):
    rng, x = np.random.default_rng(11), _noise(11)
    x = np.round(x / step) * step if step else x
    held = np.zeros(x.size, dtype=bool)
    for first in np.arange(300, x.size - 500, 30 * length) + rng.integers(
        0, 20 * length, len(x[300 : -500 : 30 * length])
    ):
        x[first : first + length] = x[first]
        held[first + 1 : first + length] = True
    parts = repaired(_imu(x, gyro_y=_noise(12)))
    part = next(part for part in parts if "gyro_x" in part.axes)
    assert part.axes == ("gyro_x",)
    assert len(part) == pytest.approx(np.count_nonzero(~held), abs=0.001 * x.size)
    facts = only(part.remarks, "fault-undone:frozen").facts
    assert facts["longest"].value == pytest.approx(length / RATE, abs=0.021)
    assert facts["share"] == pytest.approx(100 * np.mean(held), abs=0.1)
    assert all(len(other) == x.size for other in parts if other is not part)


def _held(x, longest, share, seed):
    """Hold values for 1 to `longest` samples more, in a share of the time; also return which samples are held."""
    rng, held = np.random.default_rng(seed), np.zeros(x.size, dtype=bool)
    for first in rng.integers(1, x.size, round(2 * share * x.size / (1 + longest))):
        held[first : first + int(rng.integers(1, longest + 1))] = True
    return x[np.maximum.accumulate(np.where(held, 0, np.arange(x.size)))], held


@pytest.mark.parametrize("step", [1e-5, 5e-4, 1.6e-3])
@pytest.mark.parametrize(("longest", "share"), [(1, 0.2), (50, 0.05), (50, 0.4)])
@pytest.mark.parametrize("together", [False, True])
def test_held_values_of_any_output_are_gaps(step, longest, share, together):
    x, y = (np.round(_noise(seed, 60_000) / step) * step for seed in (21, 22))
    values, held = _held(x, longest, share, 23)
    parts = repaired(_imu(values, gyro_y=_held(y, longest, share, 23)[0] if together else y))
    part = next(part for part in parts if "gyro_x" in part.axes)
    assert {"fault-undone:repeated", "fault-undone:frozen"} & _codes(part)
    assert x.size - len(part) == pytest.approx(np.count_nonzero(held), rel=0.15)
    assert all(len(other) == x.size for other in parts if "gyro_x" not in other.axes) or together
    # The correlation of neighbours over short gaps is that of the sensor.
    left = part["gyro_x"].values
    pairs = [left[a:b] for a, b in part["gyro_x"].segments if b - a > 1]
    products = sum(float((run[1:] - left.mean()) @ (run[:-1] - left.mean())) for run in pairs)
    assert abs(products / sum(run.size - 1 for run in pairs) / left.var()) < 0.02


@pytest.mark.parametrize("step", [0.2, 0.7, 1.5, 2.5])
@pytest.mark.parametrize("kind", ["white", "one pole", "mean of 3", "tails", "slow", "counter", "line"])
def test_equal_neighbours_by_chance_are_not_held(step, kind):
    for seed in range(3):
        rng = np.random.default_rng((31, seed))
        x, at = rng.normal(size=40_000), np.arange(40_000)
        if kind == "one pole":
            x = lfilter([1], [1, -rng.uniform(0.1, 0.95)], x)
        elif kind == "mean of 3":
            x = np.convolve(x, np.ones(3), "same")
        elif kind == "tails":
            x = rng.standard_t(3, size=x.size)
        elif kind == "slow":
            x += np.cumsum(rng.normal(size=x.size)) * 10 ** rng.uniform(-3, -1.5)
        elif kind == "counter":
            x = 0.5 * x + np.diff(rng.normal(size=x.size + 1))
        elif kind == "line":
            x += rng.uniform(0.3, 2) * np.sin(2 * np.pi * 10 ** rng.uniform(-3, -0.4) * at)
        output = np.round(x / np.std(x) / step) * step
        assert held_by_chance([output], repeats([output], np.array([0]))) is None


def test_axes_that_repeat_at_different_times_are_divided():
    x, y = _noise(13), _noise(14)
    x[100::50], y[120::50] = x[99:-1:50], y[119:-1:50]
    parts = repaired(_imu(x, gyro_y=y))
    assert [(part.axes, x.size - len(part)) for part in parts] == [(("gyro_x",), 398), (("gyro_y",), 398)]


@pytest.mark.slow
@pytest.mark.parametrize("digits", [3, 4])
@pytest.mark.parametrize("kind", ["white", "smooth", "walk"])
def test_clean_text_with_few_digits_has_no_holds(digits, kind):
    for seed in range(6):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=8_000)
        if kind == "smooth":
            x = _low_pass(_low_pass(x, 0.1), 0.1)
        x = np.cumsum(x) if kind == "walk" else x
        x = 10.0 ** -rng.integers(0, 4) * x + rng.normal()
        recording = _imu(np.array([float(f"{value:.{digits}g}") for value in x]))
        (part,) = repaired(recording)
        assert not {"fault-undone:frozen", "fault-undone:repeated"} & _codes(part)


@pytest.mark.parametrize(("count", "least", "most"), [(20, 6, 40), (400, 1, 4)])
@pytest.mark.parametrize("lsb", [0.0, 1e-5])
def test_interpolated_samples_are_gaps(count, least, most, lsb):
    """Also single ones, if the output is so fine that few samples are on a line by chance."""
    rng, x = np.random.default_rng(5), _noise(5)
    x = np.round(x / lsb) * lsb if lsb else x
    inside = np.zeros(x.size, dtype=bool)
    for first in rng.integers(100, x.size - 100, count):
        last = first + int(rng.integers(least, most))
        x[first:last] = np.interp(np.arange(first, last), [first - 1, last], [x[first - 1], x[last]])
        inside[first:last] = True
    (part,) = repaired(_imu(x))
    assert "fault-undone:interpolated" in _codes(part)
    assert len(part) == pytest.approx(np.count_nonzero(~inside), abs=30)


def test_words_that_wrapped_around_are_moved_back():
    counts = np.round(_noise(6) / 1e-4).astype(int) + 32_750
    wrapped = (counts + 32_768) % 65_536 - 32_768
    assert np.any(wrapped != counts)
    (part,) = repaired(_imu(wrapped * 1e-4))
    assert np.allclose(part["gyro_x"].values, counts * 1e-4)
    assert "fault-undone:wrapped" in _codes(part)


@pytest.mark.parametrize("bits", [14, 16, 24])
@pytest.mark.parametrize("end", [-3.0, 0.0, 3.0, "ramp"])
def test_wraps_are_found_at_any_share(bits, end):
    rng, n = np.random.default_rng(bits), 20_000
    course = np.linspace(-20, 20, n) if end == "ramp" else end
    counts = np.round(5 * (rng.normal(size=n) + course)).astype(int)
    modulus, middle = modulus_of(((counts + 2**bits) % 2**bits) * 1e-4)
    assert modulus == pytest.approx(2**bits * 1e-4)
    assert min(abs(middle), abs(middle - modulus)) < 0.02


@pytest.mark.parametrize("kind", ["random", "equal", "power", "bit"])
def test_outliers_are_not_wraps(kind):
    rng, n = np.random.default_rng(7), 5_000
    for _ in range(50):
        counts = np.round(1e4 * _noise(int(rng.integers(1000)), n) + 100).astype(int)
        at = rng.choice(n, size=60, replace=False)
        if kind == "bit":
            counts[at] ^= 1 << int(rng.integers(9, 15))
        else:
            counts[at] += {
                "random": rng.integers(500, 50_000, 60),
                "equal": rng.integers(500, 50_000) + rng.integers(-20, 20, 60),
                "power": 2 ** rng.integers(9, 15),
            }[kind]
        assert modulus_of(counts * 1e-4) is None


def test_a_filtered_coarse_output_does_not_repeat():
    for seed in range(10):
        x = _low_pass(_noise(seed), 0.02)
        step = 4 * np.std(np.diff(x))
        coarse = np.round(x / step) * step
        assert repeats_of([coarse], repeats([coarse], np.array([0]))) is None


@pytest.mark.parametrize("step", [0.0, 8e-4])
def test_chunks_give_the_same_samples(tmp_path, step):
    rng, x = np.random.default_rng(8), _noise(8, 60_000)
    x = np.round(x / step) * step if step else x
    lost = rng.random(x.size) < (0.1 if step else 0.02)
    lost[0] = False
    x = x[np.maximum.accumulate(np.where(lost, 0, np.arange(x.size)))]
    _imu(x).write(tmp_path / "log.csv")
    (whole,) = repaired(gmwm.read(tmp_path / "log.csv"))
    (stream,) = repaired(gmwm.stream(tmp_path / "log.csv", chunk=1000))
    parts = list(stream.samples())
    assert len(parts) > 1
    assert np.array_equal(np.concatenate([part.values["gyro_x"] for part in parts]), whole["gyro_x"].values)
    assert stream.remarks == whole.remarks
    assert stream.time_base == whole.time_base


@pytest.mark.parametrize("share", [0.05, 0.5])
def test_noise_with_two_levels_is_named_and_not_changed(share):
    rng, at, state, parts = np.random.default_rng(9), 0, False, []
    while at < 60_000:
        length = int(rng.exponential(200 if state else 200 * (1 - share) / share)) + 1
        parts.append(np.full(length, float(state)))
        at, state = at + length, not state
    x = _noise(9, 60_000) + 2e-3 * np.concatenate(parts)[:60_000]
    (part,) = repaired(_imu(x))
    assert np.array_equal(part["gyro_x"].values, x)
    remark = only(part.remarks, "heavy-tails:levels", "gyro_x")
    assert remark.facts["duration"].value == pytest.approx(2.0, rel=0.5)


def test_motion_at_the_end_is_not_a_second_level():
    x = _noise(10, 60_000)
    x[-3000:] += 0.05 * np.sin(np.arange(3000) / 50)
    assert two_levels_of(x) is None


@pytest.mark.parametrize("place", [0.3, 0.5, 0.7])
def test_one_jump_is_not_a_second_level(place):
    """Single means cross the middle by noise again and again, with a jump of 1.3 standard deviations."""
    x = _noise(10, 240_000)
    x[int(place * x.size) :] += 1.35 * np.std(np.diff(x)) / np.sqrt(2)
    assert two_levels_of(x) is None
