"""Options are checked when they are made: before a file is opened and before anything is measured."""

import pytest

import gmwm
from gmwm.calibration.options import CalibrationOptions
from gmwm.errors import OptionError, UnitError
from gmwm.options import ReadOptions, as_confidence

WRONG_READING = [
    ({"rate": -1}, OptionError, "rate must be positive"),
    ({"gaps": "glue"}, OptionError, "gaps must be 'keep' or 'longest', got 'glue'"),
    ({"units": {"gyro": "furlong"}}, UnitError, "furlong"),
    ({"units": {"time": "fortnight"}}, UnitError, "the time unit must be one of s, ms"),
    ({"units": "deg/s"}, OptionError, "units must map"),
    ({"columns": {"gyro_w": 1}}, OptionError, "columns= must name gyro_x"),
    ({"columns": ["gyro_x", "gyro_x"]}, OptionError, "columns= names 'gyro_x' twice"),
    ({"columns": "gyro_x"}, OptionError, "columns= must map"),
    ({"start": -1.0}, OptionError, "start must be a time in seconds"),
    ({"start": 5.0, "stop": 2.0}, OptionError, "stop must come after"),
    ({"skip": [(3.0, 1.0)]}, OptionError, "skip must hold pairs with the earlier time first"),
    ({"scale": {"gyro": 0}}, OptionError, "the scale of gyro must be a finite number"),
    ({"increments": ["gyro_w"]}, OptionError, "increments must name gyro, accel"),
    ({"topic": 3}, OptionError, "topic must be the name of a recording"),
]


@pytest.mark.parametrize(("options", "kind", "words"), WRONG_READING)
def test_a_wrong_option_is_refused_before_the_file_is_opened(options, kind, words):
    with pytest.raises(kind, match=words):
        ReadOptions(**options)
    with pytest.raises(kind, match=words):
        gmwm.read("no such file.csv", **options)
    with pytest.raises(kind, match=words):
        gmwm.fleet(["no such file.csv"], "out", reading=options)
    if "gaps" not in options:
        with pytest.raises(kind, match=words):
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


@pytest.mark.parametrize("confidence", [0.3, 0.0, 1.0, 95, float("nan"), "high", True, None])
def test_one_rule_for_confidence_before_anything_is_measured(confidence):
    words = "must be at least 0.5 and less than 1, got"
    for refused in (
        lambda: as_confidence(confidence),
        lambda: CalibrationOptions(confidence=confidence),
        lambda: gmwm.calibrate({"gyro_x": Unmeasurable()}, confidence=confidence),
        lambda: gmwm.select("WN + RW", Unmeasurable(), confidence=confidence),
        lambda: gmwm.rank(["WN", "RW"], Unmeasurable(), confidence=confidence),
        lambda: gmwm.fleet(["no such file.csv"], "out", confidence=confidence),
    ):
        with pytest.raises(OptionError, match=words):
            refused()


@pytest.mark.parametrize("confidence", [0.3, 1.0, 95])
def test_intervals_and_limits_have_the_rule_of_calibrations(confidence):
    signal = gmwm.simulate_signal("WN(sigma2=4.0)", rate=100.0, samples=4096, rng=1).signal
    found = gmwm.fit("WN", signal)
    for refused in (
        lambda: gmwm.wavelet_variance(signal, confidence=confidence),
        lambda: found.confidence_intervals(confidence),
        lambda: found.datasheet(confidence),
    ):
        with pytest.raises(OptionError, match=r"must be at least 0\.5 and less than 1, got"):
            refused()


def test_the_saved_options_of_a_calibration_come_back():
    given = CalibrationOptions(within="WN(sigma2=fixed(1e-6)) + RW", robust=True, confidence=0.9, axes="gyro")
    assert list(given.to_dict()) == [
        "within", "robust", "weighting", "criterion", "confidence", "efficiency", "draws", "seed",
    ]  # fmt: skip
    assert CalibrationOptions.from_dict(given.to_dict()).to_dict() == given.to_dict()
    assert given.axes == ("gyro",)


class Unmeasurable:
    """Data that must not be looked at."""

    def __getattr__(self, name):
        raise AssertionError(f"{name} was looked at")
