"""The monitor: faults in simulated signals, gaps, motion, independence of cuts, state, errors."""

from __future__ import annotations

import json
import pickle
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import gmwm
from gmwm import Model, Monitor
from gmwm.applications.monitor import Baseline, Event
from gmwm.base.errors import DataError, ModelError, OptionError, ReadError
from gmwm.recording.chunks import Chunk

RATE = 100.0
SIGMA = 4.4e-4
"""White noise of 0.15 deg/√h at 100 Hz, in rad/s."""
TEXT = f"GM(beta=0.02, sigma2={1.4e-4**2}) + WN(sigma2={SIGMA**2}) + RW(gamma2=5.9e-18)"
MODEL = Model.parse(TEXT)
START = 30_000
AXES = ("gyro_x", "gyro_y", "gyro_z")

Array = NDArray[np.float64]


def noise(samples: int, seed: int) -> Array:
    return np.asarray(MODEL.simulate(samples, RATE, rng=seed))


def monitor(*axes: str, every: float = 1e5) -> Monitor:
    return Monitor(dict.fromkeys(axes or ("gyro_x",), MODEL), every, rate=RATE, baseline=None)


def events_of(x: Array) -> list[Event]:
    made = monitor()
    return made.update({"gyro_x": x}) + made.finish()


def faulty(kind: str, seed: int) -> Array:
    x, rng = noise(START + 12_000, seed), np.random.default_rng(seed)
    after = x[START:]
    if kind == "noise-up":
        after += 1.2 * SIGMA * rng.standard_normal(after.size)
    elif kind == "noise-down":
        x[START:] = np.convolve(x, [0.5, 0.5])[START : x.size]
    elif kind == "jump":
        after += 2.0 * SIGMA
    elif kind == "hum":
        after += 0.5 * SIGMA * np.sin(2 * np.pi * 10.0 * np.arange(after.size) / RATE)
    elif kind == "spike":
        after[100] += 12.0 * SIGMA
    elif kind == "frozen":
        after[:] = after[0]
    elif kind == "saturated":
        after[:] = 0.5
    elif kind == "ramp":
        after += 4e-5 * np.arange(after.size) / RATE
    return x


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["noise-up", "noise-down", "jump", "hum", "spike", "frozen", "saturated", "ramp"])
def test_each_fault_is_reported_once_with_its_kind(kind: str) -> None:
    for seed in (1, 2, 3):
        found = events_of(faulty(kind, seed))
        assert [event.kind for event in found] == [kind]
        (event,) = found
        assert event.time >= START / RATE - 0.1
        assert abs(event.began - START / RATE) < {"ramp": 60, "hum": 10}.get(kind, 1.1)


@pytest.mark.slow
def test_sizes_are_right() -> None:
    jump, hum, noisier, spike = (
        np.median([getattr(events_of(faulty(kind, seed))[0], name) for seed in range(5)])
        for kind, name in (("jump", "size"), ("hum", "size"), ("noise-up", "ratio"), ("spike", "size"))
    )
    assert jump == pytest.approx(2.0 * SIGMA, rel=0.2)
    assert hum == pytest.approx(0.5 * SIGMA, rel=0.3)
    assert noisier == pytest.approx(np.sqrt(1 + 1.2**2), rel=0.2)
    assert spike == pytest.approx(12 * SIGMA, rel=0.2)
    assert events_of(faulty("hum", 1))[0].frequency == pytest.approx(10.0, abs=0.2)


def test_a_good_sensor_gives_no_event() -> None:
    assert events_of(noise(200_000, 11)) == []


def story() -> dict[str, Array]:
    """Three axes with a fault each, and a time of motion."""
    x = {axis: noise(24_000, 20 + k) for k, axis in enumerate(AXES)}
    x["gyro_x"][6000:] += 3 * SIGMA
    x["gyro_y"][9000:10_000] += 2 * SIGMA * np.random.default_rng(1).standard_normal(1000)
    for k, axis in enumerate(AXES):
        x[axis][14_000:14_700] += 0.3 * np.sin(np.arange(700) / (10.0 + k))
        x[axis][14_700:] += 0.001 * k
    x["gyro_z"][20_000:20_300] = x["gyro_z"][20_000]
    return x


@pytest.mark.slow
def test_motion_is_one_event_and_the_charts_rest() -> None:
    made = monitor(*AXES)
    found = made.update(story()) + made.finish()
    assert [(event.kind, event.axis) for event in found] == [
        ("jump", "gyro_x"), ("noise-up", "gyro_y"), ("moved", ""), ("still", ""), ("frozen", "gyro_z"),
    ]  # fmt: skip
    moved, still = found[2:4]
    assert moved.time == pytest.approx(140.0, abs=0.3)
    assert 149.0 < still.time < 153.0
    assert not made.resting


@pytest.mark.slow
def test_events_do_not_depend_on_cuts_pickles_and_json() -> None:
    x = story()
    whole = monitor(*AXES)
    wanted = whole.update(x) + whole.finish()
    rng = np.random.default_rng(5)
    cuts = [0, *rng.choice(np.arange(1, 24_000), 30, replace=False).tolist(), 24_000]
    cuts = sorted({*cuts, *range(5990, 6140), *range(14_000, 14_040)})
    made, found = monitor(*AXES), []
    for a, b in pairwise(cuts):
        found += made.update({axis: values[a:b] for axis, values in x.items()})
        if rng.random() < 0.3:
            made = Monitor.from_dict(json.loads(json.dumps(made.to_dict())))
        elif rng.random() < 0.3:
            made = pickle.loads(pickle.dumps(made))
    assert found + made.finish() == wanted


def test_lost_samples_and_a_clock_that_is_set_back_are_reported() -> None:
    x, made = noise(3000, 30), monitor()
    made.update({"gyro_x": x[:1000]})
    (lost,) = made.gap(50)
    assert (lost.kind, lost.size, lost.time) == ("lost", 50.0, 10.0)
    assert (lost.description, Event(kind="lost", time=0.0, began=0.0, size=1.0).description) == (
        "50 samples lost", "1 sample lost",
    )  # fmt: skip
    assert made.gap(50) == []
    assert gmwm.Monitor.from_dict(json.loads(json.dumps(made.to_dict()))).lost == 100  # of both gaps
    assert made.update({"gyro_x": x[1000:2000]}) == []
    made = monitor()
    made.update(Chunk({"gyro_x": x[:1000]}, first=0, segment=0, start=100.0))
    (back,) = made.update(Chunk({"gyro_x": x[1000:2000]}, first=1000, segment=1, start=50.0))
    assert (back.kind, back.time, back.size) == ("clock", 110.0, 60.0)
    (late,) = made.update(Chunk({"gyro_x": x[2000:]}, first=2000, segment=2, start=61.0))
    assert (late.kind, late.size, late.time) == ("lost", 100.0, 60.0)


def test_a_recording_with_gaps_is_watched_whole() -> None:
    x = noise(20_000, 31)
    x[15_000:] += 4 * SIGMA
    missing = x.copy()
    missing[5000:5020] = np.nan
    signal = gmwm.Signal.from_missing(missing, RATE, "rad/s", "gyro_x")
    found = list(monitor().watch(gmwm.Imu({"gyro_x": signal})))
    assert [event.kind for event in found] == ["lost", "jump"]
    assert found[0].size == 20
    assert found[1].time == pytest.approx(150.05, abs=0.1)


@pytest.mark.slow
def test_a_fault_that_comes_back_within_an_hour_is_reported_once() -> None:
    x, rng = noise(90_000, 32), np.random.default_rng(32)
    for begin in (10_000, 25_000, 40_000):
        x[begin : begin + 1000] += 1.5 * SIGMA * rng.standard_normal(1000)
    assert [event.kind for event in events_of(x)] == ["noise-up"]
    x[80_000:81_000] += 6 * SIGMA * rng.standard_normal(1000)
    assert [event.kind for event in events_of(x)] == ["noise-up", "noise-up"]


@pytest.mark.slow
def test_a_baseline_absorbs_the_misfit_of_a_model() -> None:
    x = 1.3 * noise(150_000, 33)
    assert [event.kind for event in events_of(x)] == ["noise-up"]
    baseline = Baseline.of(MODEL, [x[:60_000]], RATE)
    assert baseline.ratios[0] == pytest.approx(1.69, rel=0.03)
    made = Monitor({"gyro_x": MODEL}, 1e5, rate=RATE, baseline={"gyro_x": baseline})
    assert made.update({"gyro_x": x[60_000:]}) + made.finish() == []
    assert made.remarks == ()
    again = Baseline.from_dict(json.loads(json.dumps(baseline.to_dict())))
    assert again.to_dict() == baseline.to_dict()


def test_a_baseline_of_quantized_samples_knows_their_runs() -> None:
    x = 4 * SIGMA * np.round(noise(60_000, 34) / (4 * SIGMA))
    baseline = Baseline.of(MODEL, [x], RATE)
    runs = np.diff(np.flatnonzero(np.diff(np.concatenate([[np.nan], x, [np.nan]]))))
    assert baseline.equal == runs.max()
    assert baseline.settings().equal == 2 * runs.max()


def test_a_short_reference_is_refused() -> None:
    with pytest.raises(DataError):
        Baseline.of(MODEL, [noise(500, 35)], RATE)
    with pytest.raises(ReadError):
        Baseline.from_dict({"samples": 3})


def test_power_law_noise_is_approximated_with_a_remark() -> None:
    made = Monitor({"gyro_x": "FN(b2=1e-9) + WN(sigma2=1e-6)"}, rate=RATE)
    assert {remark.code for remark in made.remarks} == {"approximated", "monitor-no-baseline"}


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"calibration": {}}, OptionError),
        ({"calibration": "results"}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "rate": None}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "every": 0.0}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "every": "soon"}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "every": 1e308}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "every": 10**400}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "axes": ["gyro_y"]}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "axes": []}, OptionError),
        ({"calibration": {"gyro_x": MODEL}, "baseline": 3}, OptionError),
        ({"calibration": {"gyro_x": "WN + RW"}}, ModelError),
    ],
)
def test_wrong_arguments_are_refused(arguments: dict[str, object], error: type[Exception]) -> None:
    with pytest.raises(error):
        Monitor(**{"rate": RATE, "baseline": None, **arguments})  # type: ignore[arg-type]


def test_wrong_samples_are_refused() -> None:
    made = monitor("gyro_x", "gyro_y")
    for values in (
        {"gyro_x": [1.0]},
        {"gyro_x": [1.0], "gyro_y": [1.0, 2.0]},
        {"gyro_x": [1.0], "gyro_y": [np.nan]},
        {"gyro_x": [1.0], "gyro_y": [[1.0]]},
    ):
        with pytest.raises(DataError):
            made.update(values)
    with pytest.raises(OptionError):
        made.gap(0)
    with pytest.raises(ReadError):
        Monitor.from_dict({"format": "other"})
    with pytest.raises(ReadError):
        Monitor.from_dict({**made.to_dict(), "state": {}})
    state = made.to_dict()
    for deadline in (-1, 0, 10):
        with pytest.raises(ReadError, match="deadline"):
            Monitor.from_dict({**state, "state": {**state["state"], "deadline": deadline}})
    for value in (1e-308, 1e308):
        model = dict.fromkeys(made.to_dict()["models"], f"WN(sigma2={value})")
        with pytest.raises(ReadError):
            Monitor.from_dict({**made.to_dict(), "models": model})


def test_events_are_numbers_and_one_line() -> None:
    event = Event(kind="jump", time=3596.2, began=3596.1, axis="gyro_x", level=1, size=0.0019199, unit="rad/s")
    assert str(event) == "3596.2 s  gyro_x  level jumped by 0.11 deg/s (began 3596.1 s)"
    assert Event.from_dict(json.loads(json.dumps(event.to_dict()))) == event
    for wrong in ({"kind": "jump"}, {"kind": "other", "time": 0.0, "began": 0.0}):
        with pytest.raises(ReadError):
            Event.from_dict(wrong)


@pytest.mark.slow
def test_a_calibration_has_the_baseline_of_a_monitor(tmp_path: Path) -> None:
    imu = gmwm.simulate(dict.fromkeys(AXES, TEXT), rate=RATE, samples=100_000, rng=36)
    calibration = gmwm.calibrate(imu.between(0.0, 600.0), within="GM + WN + RW")
    assert set(calibration.baselines) == set(AXES)
    calibration.save(tmp_path / "calibration.json")
    again = gmwm.Calibration.load(tmp_path / "calibration.json")
    assert {axis: one.to_dict() for axis, one in again.baselines.items()} == {
        axis: one.to_dict() for axis, one in calibration.baselines.items()
    }
    made = Monitor(again, "10d")
    assert made.remarks == ()
    assert list(made.watch(imu.between(600.0, 1000.0))) == []
    imu.write(tmp_path / "static.csv")
    streamed = gmwm.calibrate(gmwm.stream(tmp_path / "static.csv"), within="GM + WN + RW")
    whole = gmwm.calibrate(gmwm.read(tmp_path / "static.csv"), within="GM + WN + RW")
    assert {a: b.to_dict() for a, b in streamed.baselines.items()} == {
        a: b.to_dict() for a, b in whole.baselines.items()
    }


@pytest.mark.slow
def test_noise_of_the_gyroscopes_beside_accelerometers_at_rest_is_no_motion() -> None:
    axes = (*AXES, *(axis.replace("gyro", "accel") for axis in AXES))
    x = {axis: noise(6000, 40 + k) * (57.2958 if axis.startswith("gyro") else 1.0) for k, axis in enumerate(axes)}
    made = monitor(*axes)
    found = made.update(x) + made.finish()
    assert {(event.kind, event.axis) for event in found} == {("noise-up", axis) for axis in AXES}
    assert all("check the unit" in event.description for event in found)


def warming(loss: float) -> gmwm.Imu:
    """Return ten minutes of six axes that drift together after the start, with a share of lost samples."""
    rng = np.random.default_rng(40)
    n = 60_000
    drift = 8 * SIGMA * np.exp(-np.arange(n) / 20_000)
    lost = rng.random(n) < loss
    lost[0] = False
    axes = {axis: np.where(lost, np.nan, SIGMA * rng.normal(size=n) + drift) for axis in AXES}
    return gmwm.Imu({axis: gmwm.Signal.from_missing(x, RATE, "rad/s", axis) for axis, x in axes.items()})


@pytest.mark.slow
@pytest.mark.parametrize("loss", [0.0, 0.01])
def test_a_warm_up_is_a_drift_of_each_axis_and_lost_samples_do_not_hide_it(loss: float) -> None:
    found = list(Monitor(dict.fromkeys(AXES, MODEL), rate=RATE, baseline=None).watch(warming(loss)))
    kinds = {(event.kind, event.axis) for event in found if event.kind != "lost"}
    assert {("ramp", axis) for axis in AXES} <= kinds
    assert "moved" not in {kind for kind, _ in kinds}
