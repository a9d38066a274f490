from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import DataError, OptionError, ReadError, UnitError
from gmwm.base.time_base import TimeBase
from gmwm.base.units import AXES
from gmwm.recording.signals import Imu, Signal
from tests.helpers import raises


def test_from_arrays_converts_to_si():
    table = np.arange(60.0).reshape(10, 6)
    imu = Imu.from_arrays(table, 50, units={"gyro": "deg/s", "accel": "g"}, start=2.0, source="x")
    assert imu.axes == AXES
    np.testing.assert_allclose(imu["gyro_y"].values, np.radians(table[:, 1]), rtol=1e-15)
    np.testing.assert_allclose(imu["accel_x"].values, table[:, 3] * 9.80665, rtol=1e-15)
    assert (imu["accel_x"].unit, imu["gyro_x"].unit, imu["gyro_x"].start) == ("m/s²", "rad/s", 2.0)
    assert imu.time_base == TimeBase(50.0, start=2.0)


@pytest.mark.parametrize(
    ("arguments", "error", "facts"),
    [
        (({"pressure": np.ones(9)}, 1), ReadError, ["pressure"]),
        ((np.ones((6, 100)), 1), DataError, ["(6, 100)"]),
        (([1.0, 2.0], 1), DataError, ["(2,)"]),
        (({"gyro_x": [1.0, np.nan]}, 1), DataError, ["gyro_x", 2, 8]),
        (({"gyro_x": [1.0], "gyro_y": [1.0, 2.0]}, 1), DataError, ["gyro_y", "2 samples", "gyro_x", "1 samples"]),
        (({"gyro_x": [1.0]}, 0), OptionError, ["rate"]),
        (({}, 1), DataError, ["axis"]),
    ],
)
def test_from_arrays_refuses(arguments, error, facts):
    with raises(error, *facts):
        Imu.from_arrays(*arguments)


def test_from_arrays_refuses_units():
    with pytest.raises(UnitError):
        Imu.from_arrays({"gyro_x": [1.0]}, 1, units={"gyro": "g"})
    with raises(OptionError, "'time'", argument="units"):
        Imu.from_arrays({"gyro_x": [1.0]}, 1, units={"time": "s"})


def test_longest_starts_when_its_segment_does():
    signal = Signal(np.arange(10.0), 10.0, segments=((0, 3), (3, 10)), starts=(5.0, 99.0))
    assert signal.longest().start == 99.0
    assert signal.longest().values.tolist() == list(range(3, 10))
    np.testing.assert_allclose(signal.times([0, 2, 3, 9]), [5.0, 5.2, 99.0, 99.6], rtol=1e-15)


def test_segments_without_starts_are_never_contiguous():
    times = Signal(np.arange(6.0), 1.0, segments=((0, 2), (2, 4), (4, 6))).times()
    assert times.tolist() == [0, 1, 3, 4, 6, 7]


def test_starts_must_fit_the_segments():
    with raises(DataError, "2 segments", argument="starts"):
        Signal(np.arange(6.0), 1.0, segments=((0, 2), (2, 6)), starts=(0.0,))


def test_pickle_keeps_everything_read_only():
    imu = Imu.from_arrays({"gyro_x": np.arange(9.0)}, 10, segments=((0, 4), (4, 9)))
    again = pickle.loads(pickle.dumps(imu))
    assert again["gyro_x"].values.tolist() == imu["gyro_x"].values.tolist()
    assert again["gyro_x"].starts == imu["gyro_x"].starts
    assert not again["gyro_x"].values.flags.writeable


def test_temperature_has_the_length_of_the_recording():
    with raises(DataError, "8 values", "9 samples", argument="temperature"):
        Imu({"gyro_x": Signal(np.arange(9.0), 1.0)}, temperature=np.arange(8.0))


NAN = float("nan")


@pytest.mark.parametrize(
    ("values", "segments", "starts"),
    [
        ([1.0, 2.0], ((0, 2),), (5.0,)),
        ([1.0, NAN, 2.0], ((0, 1), (1, 2)), (5.0, 7.0)),
        ([NAN, NAN, 1.0, 2.0, NAN, NAN, NAN, 3.0, NAN], ((0, 2), (2, 3)), (7.0, 12.0)),
    ],
)
def test_missing_samples_part_segments(values, segments, starts):
    for given in (values, np.ma.masked_invalid(values)):
        signal = Signal.from_missing(given, 1.0, "rad/s", "gyro_x", start=5.0)
        assert (signal.segments, signal.starts, signal.start) == (segments, starts, starts[0])
        assert (signal.unit, signal.axis) == ("rad/s", "gyro_x")
        assert signal.values.tolist() == [value for value in values if value == value]
    assert len(values) - np.isnan(values)[::-1].argmin() == signal.times()[-1] - 5.0 + 1.0


def test_missing_samples_are_gaps_to_every_estimate():
    model = gmwm.Model.parse("GM(beta=2.0, sigma2=1.0) + WN(sigma2=4.0)")
    x = model.simulate(4000, 100.0, rng=1)
    x[1000:1003], x[2500] = NAN, NAN
    signal = Signal.from_missing(x, 100.0)
    pieces = Signal(x[np.isfinite(x)], 100.0, segments=((0, 1000), (1000, 2497), (2497, 3996)))
    curves = [gmwm.wavelet_variance(one, fill_gaps=False).variance.tolist() for one in (signal, pieces)]
    assert curves[0] == curves[1]
    assert model.loglikelihood(signal) == model.loglikelihood(x, 100.0)


@pytest.mark.parametrize(
    ("values", "facts"),
    [([NAN, NAN], ["2 samples"]), ([1.0, np.inf, NAN], ["1 infinite", "index 1"]), (np.ones((2, 2)), ["dimension"])],
)
def test_what_cannot_be_a_signal_with_gaps(values, facts):
    with raises(DataError, *facts):
        Signal.from_missing(values, 1.0)


@pytest.mark.parametrize("given", [[1.0, NAN, 2.0], np.ma.masked_equal([1.0, 0.0, 2.0], 0.0)])
def test_missing_samples_are_not_to_be_cut_out(given):
    for door in (gmwm.wavelet_variance, Signal):
        with raises(DataError, advises=["gmwm.Signal.from_missing"]):
            door(given * 4 if isinstance(given, list) else given, 1.0)


SIMULATED = gmwm.simulate({"gyro_x": "WN(sigma2=1.0)", "gyro_y": "WN(sigma2=1.0)"}, rate=1.0, samples=50, rng=1,
                          components=True)  # fmt: skip


@pytest.mark.parametrize(
    ("given", "facts", "advises"),
    [
        (gmwm.wavelet_variance(SIMULATED.imu), ["got WaveletVariance"], []),
        (SIMULATED, ["SimulatedImu of gyro_x, gyro_y"], ["`x.imu['gyro_x']"]),
        (SIMULATED["gyro_x"], ["SimulatedSignal of WN"], ["`x.signal`"]),
        ("static.csv", ["'static.csv'"], ["`gmwm.read(path)`"]),
        (Path("static.csv"), ["Path('static.csv')"], ["`gmwm.read(path)`"]),
    ],
)
def test_what_holds_samples_is_no_signal(given, facts, advises):
    for door in (gmwm.wavelet_variance, gmwm.allan_variance):
        with raises(DataError, *facts, advises=advises):
            door(given, 1.0)


@pytest.mark.parametrize("door", [gmwm.avlr, gmwm.contamination])
def test_one_signal_is_not_a_recording(door):
    with raises(DataError, "gyro_x", "gyro_y", argument="x", advises=["'gyro_x'"]):
        door(SIMULATED.imu)


@pytest.mark.parametrize("rate", ["100", b"100", True, np.True_])
def test_a_rate_is_a_number(rate):
    signal = Signal(np.arange(9.0), 1.0)
    for call in (
        lambda: Signal(np.arange(9.0), rate),
        lambda: gmwm.wavelet_variance(np.arange(9.0), rate),
        lambda: gmwm.wavelet_variance(signal, rate),
        lambda: gmwm.fit("WN", np.arange(9.0), rate),
        lambda: gmwm.fit_ml("WN", signal, rate),
    ):
        with raises(OptionError, argument="rate"):
            call()


@pytest.mark.parametrize("rate", [100, np.int32(100), np.float32(100.0), np.float64(100.0)])
def test_every_number_is_a_rate(rate):
    assert Signal([1.0], rate).rate == 100.0


def test_a_sensor_of_a_recording_is_a_recording():
    table = np.arange(60.0).reshape(10, 6)
    imu = Imu.from_arrays(table, 50, source="x", segments=((0, 4), (4, 10)))
    for sensor in ("gyro", "accel"):
        part = imu[sensor]
        assert isinstance(part, Imu)
        assert part.axes == tuple(axis for axis in AXES if axis.startswith(sensor))
        assert (part.source, part.rate, part.segments) == ("x", 50.0, imu.segments)
        assert all(part[axis] is imu[axis] for axis in part)
    assert Imu.from_arrays({"accel_y": [1.0, 2.0]}, 50)["accel"].axes == ("accel_y",)
    with raises(DataError, "gyro_x", "gyro_y", "gyro_z", "'accel'", argument="axis"):
        imu["gyro"]["accel"]


def test_samples_at_odd_addresses_are_copied():
    odd = np.frombuffer(bytearray(801), np.uint8)[1:].view(np.float64)
    assert not odd.flags.aligned
    assert Signal(odd, 100.0).values.flags.aligned


@pytest.mark.parametrize("unit", ["rad/s", "m/s²"])
@pytest.mark.parametrize("value", [1.1e12, 3.4e38, -1e300])
def test_values_that_no_sensor_measures_are_refused(value, unit):
    values = np.random.default_rng(1).normal(size=100)
    values[40] = value
    with raises(DataError, "index 40", argument="gyro_x", got=value):
        Signal(values, 100.0, unit, "gyro_x")
    Signal(values, 100.0)  # a quantity of another kind
