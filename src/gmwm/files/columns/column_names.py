"""Recognise the quantity, the axis and the unit in the name of a column, also in short names."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from gmwm.base.units import AXES, SI_UNIT, TIME_WORDS, find_time_unit, find_unit
from gmwm.files.contract import Channel

_GYRO = {
    "gyro", "gyr", "gyroscope", "gyros", "gyroscopes", "omega", "w", "g", "angvel", "angularvelocity",
    "angularrate", "angrate", "rate", "turnrate", "rotationrate", "imugyro", "ω", "pqr", "angularvel", "角速度",
}  # fmt: skip
_ACCEL = {
    "accel", "acc", "accelerometer", "acceleration", "accelerometers", "a", "alpha", "f", "specificforce",
    "linearacceleration", "linacc", "totalacceleration", "imuaccel", "imuacc", "accl", "gforce", "加速度",
}  # fmt: skip
_OTHER = {
    "mag", "magnetometer", "magnetic", "std", "stddev", "sigma", "cov", "covariance", "bias", "var",
    "variance", "quat", "quaternion", "orientation", "inc", "increment", "delta", "jerk", "temp", "valid",
    "status", "reference", "ref", "user", "free", "desired", "setpoint", "target", "command", "cmd", "error",
}  # fmt: skip
_TIME = {
    "time", "t", "timestamp", "timestamps", "stamp", "timestamputc", "sensortime", "gpstime", "tow",
    "secondselapsed", "timeelapsed", "elapsedtime", "elapsed", "headerstamp", "fieldheaderstamp",
    "sampletime", "sampletimefine", "seconds", "sec", "ts", "timestartup", "gpstow",
}  # fmt: skip
_TEMPERATURE = {"temperature", "temp", "tempc", "imutemp", "imutemperature", "sensortemperature", "温度"}

# Strings in brackets that are not units: the source of the data, the clock, or a note that the data are raw.
_REMARKS = {
    "raw", "counts", "count", "lsb", "lsbs", "adc", "digits", "bits", "cal", "calibrated", "uncalibrated", "body",
    "imu", "sensor", "meas", "measured", "x", "y", "z", "-",
}  # fmt: skip
_HARMLESS = {
    "raw", "meas", "measured", "data", "value", "imu", "cal", "calibrated", "lsb", "lsbs", "count", "counts", "adc",
    "digits", "bits", "out",
}  # fmt: skip
_FILL_WORDS = {"axis", "in", "channel"}  # words in names such as "acceleration in g, x axis"
_NOT_SAMPLES = {
    "accuracy", "offset", "scale", "noise", "time", "timestamp", "stamp", "counter", "clip", "clipping", "range",
    "mean", "min", "max", "rms", "norm", "enabled", "flag", "health", "type", "id", "fft", "psd", "angle", "linear",
    "gravity",
}  # fmt: skip
_MENTIONS = {"gyro": r"gyr|omega|angular(?:rate|vel)|(?:turn|rotation)rate", "accel": r"acc(?!u|ept|ess)|specificforce"}
_FIELDS = {"h", "b", "m", "field", "compass", "velocity", "vel", "force"}  # magnetic fields may be in mG, milligauss
_CLOCKS = {"utc", "gps", "gnss", "tai", "unix", "epoch", "posix", "ros", "local", "host", "device", "sensor", "elapsed"}

_ELEMENT = re.compile(r"(?<!(?<![xyz])[xyz])\[([012])\]", re.I)  # gyroADC[0] is the x axis, but gyro_z[0] is z

LONGEST_NAME = 200
"""Largest number of characters of a name or unit that are searched. Much longer strings would take minutes."""
_BRACKETED = re.compile(r"\s*[\[({<]\s*([^\])}>]*?)\s*[\])}>]\s*$")
_BRACKET_WITHIN = re.compile(r"\s*[\[({<]\s*([^\])}>]*[a-zA-Z°º][^\])}>]*?)\s*[\])}>]")
_INVERSE = re.compile(r"(?<=[sc])\s?\^?[-−⁻]\s?([12¹²])(?!\d)")  # pattern of s^-1 and s⁻², which are one word
_CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])|(?<=[XYZ])(?=[A-Z][a-z])|(?<=[a-z][XYZ])(?=[a-z]{2})(?!aw)")
_MEGA = ("Mg", "MG")
"""Spellings that keep their case, because they are not a unit of accelerometers: mega-g is not milli-g."""


@dataclass(frozen=True)
class ColumnName:
    """Axis and unit in the name of a column."""

    axis: str = ""  # "gyro_x" … "accel_z", "time", "temperature", or "" if the name is not recognised
    unit: str = ""  # unit in the spelling of `gmwm.units` or of time units; "" if the name has none
    ros: bool = False  # whether this is a field of the ROS message sensor_msgs/Imu, whose units REP-103 fixes


def recognise(name: str) -> ColumnName:
    """Recognise the axis and the unit in a column name."""
    text = _ELEMENT.sub(lambda match: f"_{'xyz'[int(match[1])]}", clean(name), count=1)
    text, unit_text = _without_bracket(text)
    words = _words(text)
    if words[-2:-1] == ["stamp"] and words[-1] in TIME_WORDS:
        return ColumnName()  # half of a ROS stamp in two columns, header.stamp.sec and .nanosec
    tail_unit = ""
    axis = _axis(words)
    while not axis and len(words) > 1:
        # Words after the axis can only be its unit: gyro_x_rad_s, time_us.
        tail_unit, words = words[-1] + tail_unit, words[:-1]
        axis = _axis(words)
    if not axis:
        return _by_unit(words, tail_unit, unit_text)
    known = unit_of(tail_unit, axis)
    unit = unit_of(unit_text, axis) or known
    if axis == "temperature" and known == tail_unit:
        known = ""
    if tail_unit and not known and not (tail_unit.isdigit() or tail_unit in _HARMLESS):
        return ColumnName()  # for example gyro_x_std and accel_x_bias, which are not samples
    joined = "".join(words)
    if joined == "ts" and unit_of(unit_text, "temperature") == "°C":
        return ColumnName("temperature", "°C")  # the spelling of Epson units; otherwise ts is a time stamp
    if axis == "time" and joined.startswith("sec"):
        unit = unit or "s"
    if axis in AXES and words[-1] in ("x", "y", "z"):
        unit = unit or _last_unit(words[1:-1], axis)  # gyro_dps_x
    return ColumnName(axis, unit, "angularvelocity" in joined or "linearacceleration" in joined)


def _without_bracket(text: str) -> tuple[str, str]:
    """Split a name and its bracket; a bracket within the name counts if it holds a unit."""
    if bracket := _BRACKETED.search(text):
        return text[: bracket.start()], bracket.group(1)
    within = _BRACKET_WITHIN.search(text)
    if within and find_unit(within[1]) is not None:
        return f"{text[: within.start()]} {text[within.end() :]}", within[1]
    return text, ""


def _last_unit(words: list[str], axis: str) -> str:
    """Return the unit of `axis` that the last words spell; "" if they spell none."""
    units = (unit_of("".join(words[-count:]), axis) for count in range(min(5, len(words)), 0, -1))
    return next((unit for unit in units if unit), "")


def role_of(channel: Channel) -> str:
    """Return the role of a column, by its format or its name: an axis, "time", "temperature" or ""."""
    return channel.axis or recognise(channel.name).axis


def _by_unit(words: list[str], tail: str, unit: str) -> ColumnName:
    """Return the axis of a column whose name is only a letter and a unit, such as X (rad/s), x_dps or dps_x."""
    if tail in ("x", "y", "z") and not unit and words != ["gravity"]:  # which is what phones call a vector
        letter, unit = tail, "".join(words)
    else:
        letter, unit = "".join(words), tail or unit
    if letter in ("x", "y", "z"):
        for quantity in ("gyro", "accel"):
            if name := unit_of(unit, quantity):
                return ColumnName(f"{quantity}_{letter}", name)
    return ColumnName()


def named_unit(name: str, axis: str) -> str:
    """Return the unit in a column name if it is a unit of `axis`; otherwise ""."""
    column = recognise(name)
    if column.unit and column.axis.split("_")[0] == axis.split("_")[0]:
        return column.unit
    text, unit = _without_bracket(clean(name))
    if unit:
        return unit_of(unit, axis)
    words = _words(text)[1:]
    if axis == "time":
        return TIME_WORDS.get(words[-1], "") if words and len(words[-1]) > 1 else ""
    return _last_unit(words, axis) if axis in AXES else ""


def bare_words(name: str) -> list[str]:
    """Return the words of a column name without its unit.

    >>> bare_words("p_rad_s"), bare_words("sys_time [ms]")
    (['p'], ['sys', 'time'])
    """
    words = _words(_without_bracket(clean(name))[0])
    for count in range(min(5, len(words) - 1), 0, -1):
        if any(unit_of("".join(words[-count:]), axis) for axis in ("gyro", "accel", "time")):
            return words[:-count]
    return words


def is_interval(name: str) -> bool:
    """Return whether a column holds the time since the row before, by its name.

    >>> is_interval("dt [ms]"), is_interval("deltaTime_us"), is_interval("time")
    (True, True, False)
    """
    pattern = r"(?:imu_?)?(?:dt|δt|delta_?t(?:ime)?|time_?(?:delta|step|diff)|(?:sampl(?:e|ing))?_?(?:period|interval))"
    return re.fullmatch(pattern, "_".join(bare_words(name))) is not None


def mentioned_sensor(name: str) -> tuple[str, str]:
    """Return the sensor and the direction that a column name mentions, whether or not it is a name of an axis.

    >>> mentioned_sensor("gyro_x_furlong"), mentioned_sensor("gyro_x_std")
    (('gyro', 'x'), ('', ''))
    """
    words = _words(clean(name))
    letter = next((word[-1] for word in words if re.fullmatch(r"(?:(?:gyr|acc)\w*)?[xyz]", word)), "")
    if not letter or (_OTHER | _NOT_SAMPLES) & set(words):
        return "", ""
    joined = "".join(words)
    if "angularacc" not in joined:
        for sensor, pattern in _MENTIONS.items():
            if re.search(pattern, joined):
                return sensor, letter
    return "", ""


def axis_by_unit(name: str) -> tuple[str, str]:
    """Return the axis that the unit and a letter of a column name imply, and the name without the letter; ("", "") if
    they imply none.

    >>> axis_by_unit("AsX(°/s)"), axis_by_unit("MagX (mG)"), axis_by_unit("RateStdX (°/s)")
    (('gyro_x', 'as'), ('', ''), ('', ''))
    """
    text, unit = _without_bracket(clean(name))
    words = _words(text)
    if not words or (_OTHER | _NOT_SAMPLES | _FIELDS) & set(words) or any(word.startswith("mag") for word in words):
        return "", ""
    for letter, stem in _letters(words):
        for sensor in SI_UNIT:
            # The g of imu_gx is a gyroscope and not a unit.
            stated = unit_of(unit, sensor) or (letter in words and _last_unit(stem[1:], sensor))
            if stem and not _FIELDS & set(stem) and stated:
                return f"{sensor}_{letter}", "".join(stem)
    return "", ""


def unknown_unit(name: str, stated: str, axis: str) -> str:
    """Return what a column states as its unit if this is not a unit of its axis; otherwise "".

    `stated` is the unit that the file states in addition to the name.

    >>> unknown_unit("gyro_x [furlong/s]", "", "gyro_x"), unknown_unit("gyro_x [deg/s]", "", "gyro_x")
    ('furlong/s', '')
    """
    bracket = _BRACKETED.search(clean(name))
    remarks = _CLOCKS if axis == "time" else _REMARKS
    for text in (bracket.group(1) if bracket else "", stated.strip()):
        number = re.fullmatch(r"[\d:,.\s]*", text) is not None  # w[0], gyro(:,1)
        if not number and text.casefold() not in remarks and not unit_of(text, axis):
            return text
    return ""


def unit_of(text: str, axis: str) -> str:
    """Return the standard spelling of a unit if it is a unit of `axis`; otherwise ""."""
    text = text.strip()[:LONGEST_NAME]
    key = text.strip().strip("[](){}<>").casefold().replace(" ", "")
    if axis == "time":
        return find_time_unit(text)
    if axis == "temperature":
        if re.fullmatch(r"m(illi)?[-_]?(°|deg)?[-_.]?c(elsius)?", key):
            return "m°C"
        key = key.removeprefix("°").removeprefix("deg").strip("_.")
        return {"c": "°C", "celsius": "°C", "k": "K", "kelvin": "K", "f": "°F", "fahrenheit": "°F"}.get(key, text)
    unit = find_unit(text)
    return unit.name if unit is not None and axis.startswith(unit.quantity) else ""


def is_unit(text: str) -> bool:
    """Return whether a cell contains only a unit, as in a row of units below the header."""
    key = text.strip().strip("[](){}<>").strip()
    return bool(key) and (
        any(unit_of(key, axis) for axis in ("time", "gyro", "accel")) or unit_of(key, "temperature") == "°C"
    )


def clean(name: str) -> str:
    """Return a name without quotes, surrounding blanks and the comment sign at the beginning of some headers."""
    return name.strip()[:LONGEST_NAME].lstrip("#%").strip().strip("\"'").lstrip("#%").strip()


def _words(text: str) -> list[str]:
    """Split a name into words in lower case, at punctuation, at underscores and inside camelCase."""
    text = _CAMEL.sub(" ", _INVERSE.sub(r"⁻\1", text))
    parts = (part for part in re.split(r"[^\w²°º˚⁻µμ]+|_", text) if part)
    words = [part if part in _MEGA else part.casefold() for part in parts]
    return [word for word in words if word not in _FILL_WORDS] or words


def _axis(words: list[str]) -> str:
    """Return the axis for the words of a name, or ""."""
    joined = "".join(words)
    if joined in _TIME:
        return "time"
    if joined in _TEMPERATURE:
        return "temperature"
    if not words or _OTHER & set(words):
        return ""
    for letter, others in _letters(words):
        quantity = _quantity(others)
        if quantity:
            return f"{quantity}_{letter}"
    return ""


def _letters(words: list[str]) -> list[tuple[str, list[str]]]:
    """Return all ways to split words into an axis letter and the words for the sensor."""
    splits: list[tuple[str, list[str]]] = []
    if words[-1] == "yaw":
        return splits  # the third axis; see `short_names`
    if words[-1] in {"x", "y", "z"}:
        splits.append((words[-1], words[:-1]))
    elif words[0] in {"x", "y", "z"} and len(words) > 1:
        splits.append((words[0], words[1:]))
    elif len(words[-1]) > 1 and words[-1][-1] in "xyz" and not words[-1].endswith("velocity"):
        splits.append((words[-1][-1], [*words[:-1], words[-1][:-1]]))
        if words[-1][0] in "xyz":
            splits.append((words[-1][0], [*words[:-1], words[-1][1:]]))
    elif len(words[-1]) > 1 and words[-1][0] in "xyz":
        splits.append((words[-1][0], [*words[:-1], words[-1][1:]]))
    return splits


def _quantity(words: list[str]) -> str:
    """Return the sensor for the words of a name, "gyro" or "accel", or ""."""
    joined = "".join(words)
    long = [word for word in words if len(word) > 1]
    if "angular" in joined and "acceleration" in joined:
        return ""
    for quantity, names in (("gyro", _GYRO), ("accel", _ACCEL)):
        # A single letter (w, a) is a sensor only at the beginning of the name: w_RS_S_x.
        if joined in names or any(n in joined for n in names if len(n) > 7):
            return quantity
        if any(word in names or word.rstrip("0123456789") in names for word in long):
            return quantity
        if words and words[0] in names:
            return quantity
    return ""


_TURNS = r"(?:imu|body)?(?:gyro?s?|gyroscope|omega|w|ang(?:ular)?(?:rate|vel(?:ocity)?|speed)?|rate|speed)"
_SENSORS = {
    "gyro": r"(?:imu)?(?:gyro?s?|gyroscope|omega|w|angularvelocity|angularrate)",
    "accel": r"(?:imu)?(?:acc(?:el)?|acceleration|accelerometer|specificforce|linearacceleration)",
}

# For each sensor, patterns of the words of a name without blanks. A group matches the axis.
_TRIPLES: tuple[tuple[str, str, Sequence[str], str], ...] = (
    ("gyro", r"([pqr])", "pqr", ""), ("gyro", rf"(roll|pitch|yaw){_TURNS}", ("roll", "pitch", "yaw"), ""),
    ("gyro", rf"{_TURNS}(roll|pitch|yaw)", ("roll", "pitch", "yaw"), ""), ("accel", r"t([xyz])", "xyz", r"w[xyz]"),
    *(
        (sensor, rf"{words}({'|'.join(digits)})", digits, "")
        for sensor, words in _SENSORS.items()
        for digits in ("123", "012")
    ),
)  # fmt: skip
_TIMES = (
    "systime", "systemtime", "hosttime", "imutime", "imutimestamp", "sensortimestamp", "unixtime", "epochtime",
    "uptime", "boottime", "itow", "sow", "gpssow", "gpsseconds", "secondsofweek", "timeofweek", "timeboot",
    "millis", "micros", "timems", "timeus", "timens", "ms", "us", "ns",
)  # fmt: skip
"""Names of a clock, in the order of preference. They count only if no column has a usual name of the time."""
_CLOCK = re.compile(
    r"(?!.*(?:relative|delay|exposure|integra|response|runtime|delta|local|zone|out|sync|count$))"
    r".*(?:time|elapsed|epoch|clock|datenum|ticks|zeit|tiempo|tempo$|yyyy|时间|時間|время)"
)
"""Pattern of other names of a clock, which count only if no name above does."""


def by_short_names(names: Sequence[str], roles: Iterable[str]) -> dict[str, list[int]]:
    """Return the columns of each axis, and of the time, that names state together; several with several prefixes.

    `roles` are the roles that still have no column.

    >>> by_short_names(["sys_time", "p [deg/s]", "q [deg/s]", "r [deg/s]"], ["gyro_x", "gyro_y", "gyro_z", "time"])
    {'gyro_x': [1], 'gyro_y': [2], 'gyro_z': [3], 'time': [0]}
    >>> by_short_names(["ax1", *(f"imu_{s}{axis}" for s in "ag" for axis in "xyz")], AXES)["accel_x"]
    [1]
    """
    missing, words = set(roles), ["".join(bare_words(name)) for name in names]
    out: dict[str, list[int]] = {}
    prefixed = {
        match.groups(): k
        for k, (name, word) in enumerate(zip(names, words, strict=True))
        if not (_OTHER | _NOT_SAMPLES) & set(_words(clean(name)))
        if (match := re.fullmatch(r"(.+)([ga])([xyz])", word))
    }
    prefixes = [
        p for p, s, axis in prefixed if s + axis == "gx" and all((p, t, x) in prefixed for t in "ga" for x in "xyz")
    ]
    if prefixes and set(AXES) <= missing:
        out = {axis: [prefixed[p, axis[0], axis[-1]] for p in prefixes] for axis in AXES}
    for sensor, pattern, letters, neighbour in _TRIPLES:
        if not {f"{sensor}_{axis}" for axis in "xyz"} <= missing - set(out):
            continue
        if neighbour and not any(re.fullmatch(neighbour, word) for word in words):
            continue
        places = [(match[1], k) for k, word in enumerate(words) if (match := re.fullmatch(pattern, word))]
        if sorted(letter for letter, _ in places) == sorted(letters):
            out |= {f"{sensor}_{'xyz'[letters.index(letter)]}": [k] for letter, k in places}
    implied = {axis_by_unit(name): k for k, name in enumerate(names)}
    for sensor in _SENSORS:
        axes = [f"{sensor}_{letter}" for letter in "xyz"]
        stems = {stem for _, stem in implied if all((axis, stem) in implied for axis in axes)}
        if len(stems) == 1 and set(axes) <= missing - set(out):
            out |= {axis: [implied[axis, stem]] for axis in axes for stem in stems}
    if "time" in missing:
        joined = [re.sub(r"[^a-z]", "", clean(name).casefold()) for name in names]
        stamps = [form.index(time) for time in _TIMES for form in (words, joined) if time in form]
        french = [word == "temps" and named_unit(name, "time") for word, name in zip(words, names, strict=True)]
        stamps += [k for k, word in enumerate(words) if _CLOCK.match(word) or french[k]]
        out |= {"time": stamps[:1]} if stamps else {}
    return dict(sorted(out.items(), key=lambda item: (*AXES, "time").index(item[0])))
