"""Options are checked when they are made: before a file is opened and before anything is measured."""

import pytest

import gmwm
from gmwm.base.errors import OptionError, UnitError
from gmwm.calibration.options import CalibrationOptions
from gmwm.recording.options import ReadOptions, as_confidence
from tests.helpers import raises

WRONG_READING = [
    ({"rate": -1}, OptionError, "rate", -1),
    ({"gaps": "glue"}, OptionError, "gaps", "glue"),
    ({"units": {"gyro": "furlong"}}, UnitError, None, "furlong"),
    ({"units": {"time": "fortnight"}}, UnitError, "units", "fortnight"),
    ({"units": "deg/s"}, OptionError, "units", "deg/s"),
    ({"columns": {"gyro_w": 1}}, OptionError, "columns", "gyro_w"),
    ({"columns": ["gyro_x", "gyro_x"]}, OptionError, "columns", ["gyro_x", "gyro_x"]),
    ({"columns": "gyro_x"}, OptionError, "columns", "gyro_x"),
    ({"start": -1.0}, OptionError, "start", -1.0),
    ({"start": 5.0, "stop": 2.0}, OptionError, "stop", 2.0),
    ({"skip": [(3.0, 1.0)]}, OptionError, "skip", (3.0, 1.0)),
    ({"scale": {"gyro": 0}}, OptionError, "scale", 0),
    ({"increments": ["gyro_w"]}, OptionError, "increments", "gyro_w"),
    ({"topic": 3}, OptionError, "topic", 3),
]


@pytest.mark.parametrize(("options", "kind", "argument", "got"), WRONG_READING)
def test_a_wrong_option_is_refused_before_the_file_is_opened(options, kind, argument, got):
    facts = [got] if kind is UnitError else []
    expected = {} if argument is None else {"argument": argument, "got": got}
    with raises(kind, *facts, **expected):
        ReadOptions(**options)
    with raises(kind, *facts, **expected):
        gmwm.read("no such file.csv", **options)
    with raises(kind, *facts, **expected):
        gmwm.fleet(["no such file.csv"], "out", reading=options)
    if "gaps" not in options:
        with raises(kind, *facts, **expected):
            gmwm.stream("no such file.csv", **options)


def test_read_options_have_one_form():
    given = ReadOptions(
        rate=100, units={"time": "milliseconds"}, skip=[(1, 2)], increments=["gyro"], columns=["time", None]
    )
    again = ReadOptions(**given.to_dict())
    assert again == given
    assert given.to_dict() == {
        "rate": 100.0, "columns": ["time", None], "units": {"time": "ms"}, "skip": [[1.0, 2.0]], "increments": ["gyro"],
    }  # fmt: skip
    assert ReadOptions().to_dict() == {}
    with pytest.raises(TypeError):
        ReadOptions(100.0)


@pytest.mark.slow
@pytest.mark.parametrize("confidence", [0.3, 0.0, 1.0, 95, float("nan"), "high", True, None])
def test_one_rule_for_confidence_before_anything_is_measured(confidence):
    for refused in (
        lambda: as_confidence(confidence),
        lambda: CalibrationOptions(confidence=confidence),
        lambda: gmwm.calibrate({"gyro_x": Unmeasurable()}, confidence=confidence),
        lambda: gmwm.select("WN + RW", Unmeasurable(), confidence=confidence),
        lambda: gmwm.rank(["WN", "RW"], Unmeasurable(), confidence=confidence),
        lambda: gmwm.fleet(["no such file.csv"], "out", confidence=confidence),
    ):
        with raises(OptionError, argument="confidence", advises=["95 % as 0.95"]) as caught:
            refused()
        assert caught.value.got == pytest.approx(confidence, nan_ok=True)


@pytest.mark.parametrize(
    "call",
    [
        lambda: CalibrationOptions(confidence=10**400),
        lambda: ReadOptions(rate=10**400),
        lambda: ReadOptions(scale={"gyro": 10**400}),
        lambda: ReadOptions(start=10**400),
        lambda: ReadOptions(skip=[(0, 10**400)]),
        lambda: gmwm.Signal([0.1, 0.2], 10**400),
        lambda: gmwm.wavelet_variance([0.1, 10**400], rate=1.0),
        lambda: gmwm.WN(sigma2=10**400),
    ],
)
def test_an_integer_that_is_no_floating_point_number_is_refused(call):
    with pytest.raises(gmwm.GmwmError):
        call()


@pytest.mark.parametrize("confidence", [0.3, 1.0, 95])
def test_intervals_and_limits_have_the_rule_of_calibrations(confidence):
    signal = gmwm.simulate_signal("WN(sigma2=4.0)", rate=100.0, samples=4096, rng=1).signal
    found = gmwm.fit("WN", signal)
    for argument, refused in (
        ("confidence", lambda: gmwm.wavelet_variance(signal, confidence=confidence)),
        ("level", lambda: found.confidence_intervals(confidence)),
        ("level", lambda: found.datasheet(confidence)),
    ):
        with raises(OptionError, argument=argument, got=confidence):
            refused()


def test_the_saved_options_of_a_calibration_come_back():
    given = CalibrationOptions(within="WN(sigma2=fixed(1e-6)) + RW", robust=True, confidence=0.9, axes="gyro")
    assert list(given.to_dict()) == [
        "within", "robust", "weighting", "criterion", "confidence", "efficiency", "draws", "seed", "against",
        "gravity", "tilt", "warmup", "repeated", "models",
    ]  # fmt: skip
    assert CalibrationOptions.from_dict(given.to_dict()).to_dict() == given.to_dict()
    assert given.axes == ("gyro",)


class Unmeasurable:
    """Data that must not be looked at."""

    def __getattr__(self, name):
        raise AssertionError(f"{name} was looked at")
