from __future__ import annotations

import json
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import OptionError
from gmwm.base.remarks import Dialect, Severity, texts
from gmwm.base.time_base import TimeBase
from gmwm.measuring.inspection import inspect
from gmwm.recording.resolution import lsb
from gmwm.recording.signals import Imu, Signal
from tests.helpers import code_of, codes, only, raises

RATE = 100.0


def still(samples=60_000, seed=0):
    rng = np.random.default_rng(seed)
    values = rng.normal(0, [1e-3] * 3 + [1e-2] * 3, (samples, 6))
    values[:, 5] += 9.81
    return values


def look(values, **options):
    return inspect(Imu.from_arrays(values, RATE, **options))


def test_columns_with_the_same_samples_are_refused():
    values = still(5000)
    assert look(values).remarks == ()
    values[:, 2] = values[:, 1]
    found = gmwm.calibrate(Imu.from_arrays(values, RATE), within="WN")
    copies = [remark for remark in found.recording_remarks if remark.facts.get("case") == "copy"]
    assert {remark.subject: remark.facts["reference"] for remark in copies} == {"gyro_y": "gyro_z", "gyro_z": "gyro_y"}
    refused = [axis for axis, numbers in found.number_verdicts.items() if numbers["N"].reason in copies]
    assert refused == ["gyro_y", "gyro_z"]
    values[:, 2] = 0.3 - 0.017 * np.round(values[:, 1], 4)
    assert "noise-shared" not in codes(look(values).remarks)  # rounded samples have other statistics
    values[:, 2] = 0.3 - 0.017 * values[:, 1]
    scaled = [remark.facts["factor"] for remark in look(values).remarks if remark.facts.get("case") == "copy"]
    assert scaled == pytest.approx([1 / 0.017, 0.017])
    assert "twice: gyro_y and gyro_z (those of gyro_y times 0.017, up to an offset)" in " ".join(
        look(values).summary().split()
    )
    values[:, :2] = 0.0  # constant columns are not copies
    assert "noise-shared" not in codes(look(values).remarks)


@pytest.mark.parametrize(("mean", "case"), [(0.04, "unit-contradicted:removed"), (0.06, "unit-doubtful:gravity")])
def test_accelerometers_without_gravity_can_be_used_but_not_those_with_a_wrong_unit(mean, case):
    values = still(5000)
    values[:, 5] += mean - 9.81
    (remark,) = look(values).remarks
    assert code_of(remark) == case
    assert (remark.severity is Severity.WRONG) == (mean > 0.05)


def test_gaps_that_only_some_axes_have_name_them():
    values = still(20_000)
    values[5000:7000, :2] = values[4999, :2]
    gaps = [remark for remark in look(values).remarks if remark.code == "gaps"]
    assert [remark.subject for remark in gaps] == ["gyro_x", "gyro_y"]


@pytest.mark.slow
def test_a_sensor_at_rest_gets_no_remark():
    for seed in range(5):
        found = look(still(seed=seed))
        assert found.static
        assert (found.knocks, found.remarks) == ((), ())
        assert found.gravity == pytest.approx(9.81, abs=1e-3)
        assert found.axes["gyro_x"].noise == pytest.approx(1e-3, rel=0.03)
        assert found.axes["gyro_x"].lsb is None


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_no_absolute_scale(scale):
    values = still()[:, :3]
    values[20_000:20_020, 1] += 0.1
    one, other = (look(v, axes=("gyro_x", "gyro_y", "gyro_z")) for v in (values, values * scale))
    assert [(k.time, k.axes) for k in one.knocks] == [(k.time, k.axes) for k in other.knocks] == [(200.0, ("gyro_y",))]
    assert other.static == one.static


def test_knocks_are_found_with_their_times_and_axes():
    values = still()
    values[12_345:12_350, [0, 4]] += 0.5
    values[-1, 2] += 1
    found = look(values)
    assert [(k.time, k.axes) for k in found.knocks] == [(123.45, ("gyro_x", "accel_y")), (599.99, ("gyro_z",))]
    assert found.knocks[0].duration == pytest.approx(0.04, abs=1e-9)
    assert found.static  # a knock is not motion
    remark = only(found.remarks, "knocks")
    assert (remark.severity, remark.facts["count"]) == (Severity.BIASED, 2)
    assert remark.facts["first"].value == pytest.approx(123.45)


def of_rows(stamps, values, tmp_path, **options):
    """Inspect a file with a time stamp and the values of six axes in each row."""
    path = tmp_path / "imu.csv"
    header = "time (s)," + ",".join([f"gyro_{a} (rad/s)" for a in "xyz"] + [f"accel_{a} (m/s^2)" for a in "xyz"])
    np.savetxt(path, np.column_stack([stamps, values]), "%.9g", ",", header=header, comments="")
    return inspect(gmwm.read(path), **options)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.TimeBaseWarning")
@pytest.mark.parametrize("twice", [np.arange(0, 10_000, 7), np.arange(10_000), np.arange(50, 10_000, 100)])
def test_rows_that_were_written_twice_are_named(twice, tmp_path):
    rows = np.sort(np.concatenate([np.arange(10_000), twice]))
    found = of_rows(rows / RATE, still(10_000)[rows], tmp_path, repeated="keep")
    remark = only(found.remarks, "rows-repeated")
    assert (remark.severity, remark.facts["count"]) == (Severity.WRONG, twice.size)
    assert "stamps-irregular:repeated" not in codes(found.remarks)
    once = of_rows(rows / RATE, still(10_000)[rows], tmp_path)
    assert not {"stamps-irregular:repeated", "rows-repeated", "gaps-filled"} & {*codes(once.remarks)}
    assert once.samples == 10_000
    assert once.rate == pytest.approx(RATE, rel=2e-3)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::gmwm.errors.TimeBaseWarning")
@pytest.mark.parametrize("step", [0.0, 0.005])
def test_rounded_stamps_or_a_coarse_output_are_not_rows_written_twice(step, tmp_path):
    values = still(10_000)
    values = np.round(values / step) * step if step else values
    found = of_rows(np.floor(np.arange(10_000) / 3) * 0.03, values, tmp_path)
    assert "rows-repeated" not in codes(found.remarks)
    assert only(found.remarks, "stamps-irregular:repeated")


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-9, 1.0])
def test_an_axis_that_sticks_is_named(scale):
    values = still() * scale
    values[20_000:, 1] = values[20_000, 1]
    found = look(values)
    remark = only(found.remarks, "axis-stuck", "gyro_y")
    assert remark.severity is Severity.WRONG
    assert 200 <= remark.facts["time"].value <= 210
    assert remark.facts["share"] == pytest.approx(2 / 3, abs=0.02)
    assert "recording-moved:moved" not in codes(found.remarks)


def test_a_coarse_output_without_changes_is_not_stuck():
    values = still()
    values[:, 0] = np.round(values[:, 0] / 7e-3) * 7e-3  # it changes in one of 1000 samples
    values[20_000:30_000, 0] = 0.0
    assert "axis-stuck" not in codes(look(values).remarks)


def test_motion_is_found():
    values = still()
    values[30_000:33_000, 0] += np.sin(np.arange(3000) / 30) * 0.02
    found = look(values)
    assert not found.static
    remark = only(found.remarks, "recording-moved:moved", "gyro_x")
    assert remark.severity is Severity.WRONG
    ((begin, end),) = remark.facts["ranges"]
    assert 280 <= begin < 300 < 330 < end <= 350
    assert remark.facts["ratio"] > 4


@pytest.mark.slow
def test_motion_is_one_range_without_knocks_and_jumps_at_its_edges():
    rng = np.random.default_rng(5)
    values = still(120_000)
    for first, last in ((30_300, 33_300), (80_000, 83_000)):
        values[first:last] += rng.normal(scale=0.5, size=(last - first, 6))
    values[40_000, 0] += 1.0
    found = look(values)
    moved = [remark for remark in found.remarks if remark.code == "recording-moved"]
    assert codes(moved) == ["recording-moved:moved"] * 6
    ((text, *others),) = [texts(moved, Dialect.SHELL)]
    assert not others
    assert "from 295 s to 340 s and 795 s to 835 s" in text
    assert "--skip 4min55s-5min40s,13min15s-13min55s" in text
    assert "skip=[(295, 340), (795, 835)]" in texts(moved)[0]
    assert [round(knock.time) for knock in found.knocks] == [400]
    assert not found.steps
    assert found.tilt < 0.1


@pytest.mark.slow
def test_a_turn_of_gravity_is_found():
    values = still()
    for degrees, static in ((0.01, True), (0.5, True), (5.0, False)):
        turned = values.copy()
        turned[30_000:, 3] += 9.81 * np.tan(np.radians(degrees))
        found = look(turned)
        assert found.static is static
        expected = {0.01: [], 0.5: ["recording-settles"], 5.0: ["recording-moved:tilted"]}[degrees]
        turns = [remark for remark in found.remarks if remark.code.startswith("recording-")]
        assert codes(turns) == expected
        assert [remark.facts["angle"].value for remark in turns] == [found.tilt] * len(turns)
        # The gyroscopes do not measure gravity: N and K of a unit that sank by 7° were right and could not be used.
        assert [remark.subject for remark in turns] == ["accel" if degrees == 5.0 else ""] * len(turns)


@pytest.mark.slow
def test_a_random_walk_is_no_motion():
    for seed in range(10):
        walk = np.cumsum(np.random.default_rng(seed).normal(size=60_000))
        assert look({"gyro_x": walk}).static


@pytest.mark.parametrize("step", [1e-9, 0.05, 0.00333, np.radians(0.05), 1e6])
@pytest.mark.parametrize("sd", [0.7, 3.0, 30.0])
def test_quantisation_step(step, sd):
    counts = np.round(np.random.default_rng(1).normal(5, sd, 30_000))
    assert lsb(counts * step) == pytest.approx(step, rel=1e-6)


def test_no_step_where_there_is_none():
    rng = np.random.default_rng(1)
    assert lsb(rng.normal(size=5000)) is None
    assert lsb(np.repeat(rng.normal(size=500), 10)) is None


def test_a_coarse_output_gets_a_remark():
    values = np.round(np.random.default_rng(2).normal(0.3, 0.2, 20_000))
    assert only(look({"gyro_x": values}).remarks, "coarse-output").subject == "gyro_x"


@pytest.mark.slow
def test_wrong_gravity_gets_a_remark():
    remark = only(look(still() * [1, 1, 1, 0.1, 0.1, 0.1]).remarks, "unit-doubtful:gravity")
    assert remark.severity is Severity.WRONG
    assert remark.facts["norm"].value == pytest.approx(0.981, rel=1e-3)
    off = only(look(still() * [1, 1, 1, 0.97, 0.97, 0.97]).remarks, "unit-contradicted:gravity")
    assert off.severity is Severity.BIASED
    assert off.facts["share"] == pytest.approx(-3, abs=0.1)


def test_gaps_get_a_remark_and_are_not_bridged():
    values = np.concatenate([np.zeros(5000), np.full(5000, 100.0)]) + np.random.default_rng(0).normal(size=10_000)
    signal = Signal(values, RATE, "rad/s", "gyro_x", segments=((0, 5000), (5000, 10_000)), starts=(0.0, 60.0))
    found = inspect(Imu({"gyro_x": signal}))
    assert found.axes["gyro_x"].noise == pytest.approx(1, rel=0.05)
    assert found.knocks == ()
    remark = only(found.remarks, "gaps")
    assert (remark.facts["segments"], remark.facts["missing"].unit) == (2, "s")
    assert "2 segments" in found.summary().splitlines()[0]
    assert found._repr_html_().startswith("<pre>recording: 10000 samples")
    assert "&lt;b&gt;: 10000 samples" in replace(found, source="<b>")._repr_html_()


def cut(values, segments):
    axes = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
    units = ["rad/s"] * 3 + ["m/s²"] * 3
    pairs = zip(axes, values.T, units, strict=True)
    return Imu({name: Signal(column, RATE, unit, name, segments=segments) for name, column, unit in pairs})


@pytest.mark.slow
@pytest.mark.parametrize("length", [1, 50])
def test_short_segments_do_not_inflate_wander_and_turn(length):
    values = still(10_000)
    whole = inspect(cut(values, ((0, 10_000),)))
    edges = [0, 2500, *range(2500 + length, 7500, length), 7500, 10_000]
    broken = inspect(cut(values, tuple(pairwise(edges))))
    lone = inspect(cut(values, ((0, 700), (700, 701), (701, 702), (702, 10_000))))
    for found in (broken, lone):
        assert found.static
        assert found.tilt < 1.5 * whole.tilt
        for axis in whole.axes:
            assert found.axes[axis].wander == pytest.approx(whole.axes[axis].wander, rel=0.5)


@pytest.mark.slow
def test_a_unit_that_makes_a_gyroscope_too_noisy_gets_a_remark():
    # The noise density is 0.0057 deg/s/√Hz. Numbers in deg/s that are read as rad/s give 0.33.
    assert look(still()).remarks == ()
    found = look(still() * [57.3, 57.3, 57.3, 1, 1, 1])
    assert codes(found.remarks) == ["unit-doubtful:density"] * 3
    assert [remark.subject for remark in found.remarks] == ["gyro_x", "gyro_y", "gyro_z"]
    for remark in found.remarks:
        assert remark.severity is Severity.WRONG
        assert (remark.facts["density"].unit, remark.facts["limit"].value) == ("deg/s/√Hz", 0.1)
        assert remark.facts["density"].value == pytest.approx(0.33, rel=0.07)
    knocked = still()
    knocked[300:320, 0] += 1e4
    assert codes(look(knocked).remarks) == ["knocks"]


def test_one_of_something_is_singular():
    values = still(5000)
    values[333, 1] += 1
    found = look(values)
    assert "knock at 3.33 s of one sample" in found.summary()
    (remark,) = found.remarks
    assert (remark.code, remark.facts["count"]) == ("knocks", 1)
    assert "1 knock," in remark.text()
    assert repr(found).endswith("static, 1 knock, 1 caution)")


def test_after_a_cut_gaps_of_the_rest_are_not_reported():
    rows = np.arange(3000)
    base = TimeBase(RATE, True, 0.0, 0.0, ((1000, 5.0),), 0, 1)
    values, segments = 1e-3 * np.sin(rows), ((0, 1000), (1000, 3000))
    signal = Signal(values, RATE, "rad/s", "gyro_x", segments=segments, starts=(0.0, 15.0))
    imu = Imu({"gyro_x": signal}, time_base=base)
    before = inspect(imu).remarks
    assert codes(before) == ["gaps", "stamps-irregular:backward"]
    assert (before[0].facts["segments"], before[0].facts["missing"].value) == (2, pytest.approx(4.99))
    found = inspect(imu.longest())
    assert (found.time_base.gaps, found.time_base.backward, found.time_base.start) == ((), 0, 15.0)
    assert codes(found.remarks) == ["cut:segment"]
    assert "0 gaps" in found.summary()


@pytest.mark.parametrize(
    ("given", "call"),
    [
        ("file.csv", "inspect(read('file.csv'))"),
        (np.ones((9, 6)), "Imu.from_arrays"),
        (Signal(np.arange(9.0), RATE, axis="gyro_y"), 'Imu({"gyro_y": signal})'),
    ],
)
def test_what_is_not_a_recording_gets_advice(given, call):
    with raises(OptionError, type(given).__name__, argument="recording", advises=[call]):
        inspect(given)


@pytest.mark.slow
def test_deterministic_and_ready_for_json():
    imu = Imu.from_arrays(still(), RATE)
    one, other = inspect(imu), inspect(imu)
    assert one == other
    assert json.loads(json.dumps(one.to_dict())) == one.to_dict()
    assert one.to_dict()["axes"]["gyro_x"]["unit"] == "rad/s"
    assert "specific force: 9.81" in one.summary()
    assert "6 axes" in repr(one)


def test_a_short_recording_does_not_fail():
    assert look(still(8)).samples == 8
    assert look({"gyro_x": [0.0] * 10}).axes["gyro_x"].sd == 0


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
def test_a_step_is_found_with_its_time_axis_and_size(scale):
    values = still()[:, :3]
    values[23_456:, 1] += 1.5e-3  # no sample is out of the ordinary: the noise is 1e-3
    found = look(values * scale, axes=("gyro_x", "gyro_y", "gyro_z"))
    (step,) = found.steps
    assert step.axis == "gyro_y"
    assert step.time == pytest.approx(234.56, abs=0.5)
    assert step.size == pytest.approx(1.5e-3 * scale, rel=0.3)
    assert found.knocks == ()
    assert "jump of gyro_y at 23" in found.summary()
    remark = only(found.remarks, "level-steps:clear", "gyro_y")
    assert (remark.facts["count"], remark.facts["first"].value) == (1, step.time)
    assert json.loads(json.dumps(found.to_dict()))["steps"][0]["axis"] == "gyro_y"


@pytest.mark.slow
@pytest.mark.parametrize("model", ["WN(sigma2=1.0)", "RW(gamma2=1.0)", "GM(beta=0.01, sigma2=1.0) + WN(sigma2=1.0)"])
def test_noise_has_no_steps(model):
    for samples, paths in ((3400, 40), (20_000, 20)):
        for path in gmwm.Model.parse(model).simulate(samples, RATE, 1, paths):
            assert look({"gyro_x": path}).steps == ()


@pytest.mark.parametrize("constant", [50, 400, 5000])
def test_warm_up_and_knocks_are_no_steps(constant):
    values = still()[:, :1] + 0.1 * np.exp(-np.arange(60_000) / constant)[:, None]
    values[30_000:30_020] += 0.5
    assert look(values, axes=("gyro_x",)).steps == ()


def test_a_level_that_changed_over_a_gap_is_no_step():
    values = still()[:, :1]
    values[30_000:] += 0.1
    found = look(values, axes=("gyro_x",), segments=((0, 30_000), (30_000, 60_000)))
    assert found.steps == ()
    (step,) = look(values, axes=("gyro_x",)).steps
    assert step.time == pytest.approx(300, abs=0.1)


def test_a_jump_at_a_short_gap_is_a_restart_and_another_one_is_not():
    rng = np.random.default_rng(8)
    values = rng.normal(size=60_000)
    values[30_000:] += 2.0
    lost = rng.random(60_000) < 0.001
    lost[29_990:30_000] = True
    lost[[29_989, 30_000]] = False

    def found(x):
        return gmwm.inspect(gmwm.Imu({"gyro_x": gmwm.Signal.from_missing(x, 100.0, "rad/s", "gyro_x")}))

    (step,) = found(np.where(lost, np.nan, values)).steps
    assert step.at_gap
    assert step.time == pytest.approx(300.0, abs=0.2)
    remarks = found(np.where(lost, np.nan, values)).remarks
    assert not {"level-steps:clear", "level-steps:possible"} & {*codes(remarks)}
    assert only(remarks, "gaps-filled:restart", "gyro_x").facts["count"] == 1
    lost[29_500:30_500] = False
    (step,) = found(np.where(lost, np.nan, values)).steps
    assert not step.at_gap


def dance(positions, seconds=60, rate=100.0, seed=3):
    """A recording of still positions (unit vectors of gravity) with turns of 2 s by hand between them."""
    rng = np.random.default_rng(seed)
    gravity, turning = [], []
    for k, up in enumerate(positions):
        size = int(rate * (seconds + 10 * (k == 1)))
        gravity.append(np.tile(up, (size, 1)))
        turning.append(np.zeros(size))
        if k + 1 < len(positions):
            share = np.linspace(0, 1, int(2 * rate))[:, None]
            path = (1 - share) * up + share * np.asarray(positions[k + 1]) + 0.01
            gravity.append(path / np.linalg.norm(path, axis=1, keepdims=True))
            turning.append(np.ones(len(share)))
    accel = np.vstack(gravity) * 9.80665
    moving = np.concatenate(turning)[:, None]
    accel = accel + rng.normal(size=accel.shape) * (0.02 + 0.5 * moving)
    gyro = rng.normal(size=accel.shape) * (1e-3 + 0.8 * moving)
    axes = {
        f"{name}_{axis}": table[:, k]
        for name, table in (("gyro", gyro), ("accel", accel))
        for k, axis in enumerate("xyz")
    }
    return Imu.from_arrays(axes, rate=rate)


SIX = [(0, 0, 1), (0, 0, -1), (0, 1, 0), (0, -1, 0), (1, 0, 0), (-1, 0, 0)]


@pytest.mark.parametrize("positions", [SIX, SIX[::2]])
def test_a_calibration_dance_is_not_a_recording_at_rest(positions):
    inspection = inspect(dance(positions))
    remark = only(inspection.remarks, "recording-moved:positions")
    assert remark.facts["count"] == len(positions)
    begin, end = (remark.facts[edge].value for edge in ("begin", "end"))
    assert 62 <= begin < 64  # the second position is 10 s longer
    assert 130 <= end <= 132
    assert inspection.knocks == inspection.steps == ()
    assert not inspection.static
    codes = [item.code for item in inspection.remarks]
    assert "knocks" not in codes
    assert "level-steps" not in codes
    assert f"{begin:.3f}".rstrip("0").rstrip(".") + " s" in inspection.summary()


@pytest.mark.slow
def test_one_turn_and_rest_are_no_dance():
    for positions in ([(0, 0, 1)], [(0, 0, 1), (0, 1, 0)]):
        codes = [f"{remark.code}:{remark.facts.get('case', '')}" for remark in inspect(dance(positions)).remarks]
        assert "recording-moved:positions" not in codes
