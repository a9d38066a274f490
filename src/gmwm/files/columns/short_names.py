"""Find axes by short names that mean an axis only together: p, q, r; tx, ty, tz beside wx; roll rate, pitch rate, yaw
rate; gyro1, gyro2, gyro3."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from gmwm.base.axis_names import AXES
from gmwm.files.columns.column_names import bare_words, clean

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
    "millis", "micros", "timems", "timeus", "timens",
)  # fmt: skip
"""Names of a clock, in the order of preference. They count only if no column has a usual name of the time."""


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
    if "time" in missing:
        joined = [re.sub(r"[^a-z]", "", clean(name).casefold()) for name in names]
        stamps = [form.index(time) for time in _TIMES for form in (words, joined) if time in form]
        out |= {"time": stamps[0]} if stamps else {}
    return dict(sorted(out.items(), key=lambda item: (*AXES, "time").index(item[0])))
