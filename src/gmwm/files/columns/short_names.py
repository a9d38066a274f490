"""Find axes by short names that mean an axis only together: p, q, r; tx, ty, tz beside wx; roll rate, pitch rate, yaw
rate; gyro1, gyro2, gyro3; AsX(°/s), AsY(°/s), AsZ(°/s)."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from gmwm.base.axis_names import AXES
from gmwm.files.columns.column_names import axis_by_unit, bare_words, clean, named_unit

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


def by_short_names(names: Sequence[str], roles: Iterable[str]) -> dict[str, int]:
    """Return the column of each axis, and of the time, that names state together.

    `roles` are the roles that still have no column.

    >>> by_short_names(["sys_time", "p [deg/s]", "q [deg/s]", "r [deg/s]"], ["gyro_x", "gyro_y", "gyro_z", "time"])
    {'gyro_x': 1, 'gyro_y': 2, 'gyro_z': 3, 'time': 0}
    """
    missing, words = set(roles), ["".join(bare_words(name)) for name in names]
    out: dict[str, int] = {}
    for sensor, pattern, letters, neighbour in _TRIPLES:
        if not {f"{sensor}_{axis}" for axis in "xyz"} <= missing - set(out):
            continue
        if neighbour and not any(re.fullmatch(neighbour, word) for word in words):
            continue
        places = [(match[1], k) for k, word in enumerate(words) if (match := re.fullmatch(pattern, word))]
        if sorted(letter for letter, _ in places) == sorted(letters):
            out |= {f"{sensor}_{'xyz'[letters.index(letter)]}": k for letter, k in places}
    implied = {axis_by_unit(name): k for k, name in enumerate(names)}
    for sensor in _SENSORS:
        axes = [f"{sensor}_{letter}" for letter in "xyz"]
        stems = {stem for _, stem in implied if all((axis, stem) in implied for axis in axes)}
        if len(stems) == 1 and set(axes) <= missing - set(out):
            out |= {axis: implied[axis, stem] for axis in axes for stem in stems}
    if "time" in missing:
        joined = [re.sub(r"[^a-z]", "", clean(name).casefold()) for name in names]
        stamps = [form.index(time) for time in _TIMES for form in (words, joined) if time in form]
        french = [word == "temps" and named_unit(name, "time") for word, name in zip(words, names, strict=True)]
        stamps += [k for k, word in enumerate(words) if _CLOCK.match(word) or french[k]]
        out |= {"time": stamps[0]} if stamps else {}
    return dict(sorted(out.items(), key=lambda item: (*AXES, "time").index(item[0])))
