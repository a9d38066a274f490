"""Recognise text tables of known programs and devices whose column names do not state the axis, the unit or the clock.

Sources: NCLT and KAIST Urban; PX4 guide, "ULog" and ulog2csv of pyulog; ArduPilot, LogStructure.h of
libraries/AP_InertialSensor; blackbox-tools of Betaflight; Movella DOT user manual, "Data export"; MicroStrain MIP
protocol, field sets 0x8004 and 0x8005; INSTINCT, VectorNavDataLogger; SensorLog for iOS; Physics Toolbox Sensor Suite;
OpenLog Artemis (SparkFun); Gyroflow, "gcsv reference"."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from gmwm.base.units import TIME_UNITS

_AXIS = {"0": "x", "1": "y", "2": "z"}
_RAD, _DEG, _SI, _G = "rad/s", "deg/s", "m/s²", "g"


@dataclass(frozen=True)
class KnownTable:
    """Definition of the table of one program: how to recognise it, and the role and unit of its columns."""

    program: str  # name in messages
    needed: tuple[str, ...]  # patterns, each of which must match the name of a column
    # Role ("time", "temperature", "gyro", "accel") and unit by the first matching pattern of names, whose group is the
    # axis (x, y, z or 0, 1, 2). If the unit is "", the user or the column's name must state it
    columns: tuple[tuple[str, str, str], ...]
    file: str = ""  # pattern of the name of the file; "" for any name
    above: str = ""  # pattern of text above the header; "" for any text


_UNIT = r"(?: \(.*\))?"
_TABLES = (
    KnownTable(
        "PX4's sensor_combined, exported by ulog2csv",
        (r"timestamp", r"gyro_rad\[0\]"),
        (
            (r"timestamp", "time", "us"),
            (r"gyro_rad\[([012])\]", "gyro", _RAD),
            (r"accelerometer_m_s2\[([012])\]", "accel", _SI),
        ),
    ),
    *(
        KnownTable(
            f"PX4's sensor_{sensor}, exported by ulog2csv",
            (r"timestamp", r"x", r"device_id"),
            (
                (r"timestamp_sample", "time", "us"),
                (r"timestamp", "time", "us"),
                (r"([xyz])", sensor, unit),
                (r"temperature", "temperature", "°C"),
            ),
            file=rf"sensor_{sensor}_\d+$",
        )
        for sensor, unit in (("gyro", _RAD), ("accel", _SI))
    ),
    KnownTable(
        "ArduPilot's messages IMU, ACC and GYR",
        (r"TimeUS", r"(Gyr|Acc)X"),
        (
            (r"SampleUS", "time", "us"),
            (r"TimeUS", "time", "us"),
            (r"Gyr([XYZ])", "gyro", _RAD),
            (r"Acc([XYZ])", "accel", _SI),
            (r"T", "temperature", "°C"),
        ),
    ),
    KnownTable(
        "NCLT's ms25.csv",
        (r"utime", r"rot_x"),
        ((r"utime", "time", "us"), (r"rot_([xyz])", "gyro", _RAD), (r"accel_([xyz])", "accel", _SI)),
        file=r"ms25$",
    ),
    KnownTable(
        "KAIST Urban's xsens_imu.csv",
        (r"timestamp", r"Eul_x"),
        ((r"timestamp", "time", "ns"), (r"Gyr_([xyz])", "gyro", _RAD), (r"Acc_([xyz])", "accel", _SI)),
        file=r"xsens_imu$",
    ),
    KnownTable(
        "Betaflight's blackbox_decode",
        (r"loopIteration", r"gyro(ADC|Unfilt)\[0\].*"),
        (
            (r"time \(us\)", "time", "us"),
            (rf"gyroUnfilt\[([012])\]{_UNIT}", "gyro", ""),
            (rf"gyroADC\[([012])\]{_UNIT}", "gyro", ""),
            (rf"accSmooth\[([012])\]{_UNIT}", "accel", ""),
        ),
    ),
    KnownTable(
        "Movella DOT",
        (r"SampleTimeFine", r"(Acc|Gyr)_X"),
        ((r"SampleTimeFine", "time", "us"), (r"Gyr_([XYZ])", "gyro", _DEG), (r"Acc_([XYZ])", "accel", _SI)),
        above=r"DeviceTag|MeasurementMode",
    ),
    KnownTable(
        "MicroStrain's MIP Monitor",
        (r"X (Accel \[x8004\]|Gyro \[x8005\])",),
        (
            (r"GPS TOW(?: \[x\w+\])?", "time", "s"),
            (r"([XYZ]) Gyro \[x8005\]", "gyro", _RAD),
            (r"([XYZ]) Accel \[x8004\]", "accel", _G),
        ),
    ),
    KnownTable(
        "MicroStrain's SensorConnect",
        (r".*\bscaled(Accel|Gyro)X",),
        ((r".*\bscaledGyro([XYZ])", "gyro", _RAD), (r".*\bscaledAccel([XYZ])", "accel", _G)),
    ),
    KnownTable(
        "INSTINCT",
        (r"TimeStartup(?: \[ns\])?", r"(UnComp)?(Acc|Gyro)X.*"),
        (
            (r"TimeStartup(?: \[ns\])?", "time", "ns"),
            (r"Gyro([XYZ])(?: \[.*\])?", "gyro", _RAD),
            (r"Acc([XYZ])(?: \[.*\])?", "accel", _SI),
            (r"UnCompGyro([XYZ])(?: \[.*\])?", "gyro", _RAD),
            (r"UnCompAcc([XYZ])(?: \[.*\])?", "accel", _SI),
            (r"Temperature(?: \[.*\])?", "temperature", "°C"),
        ),
    ),
    KnownTable(
        "Physics Toolbox",
        (r"time", r"gFx"),
        ((r"time", "time", "s"), (r"w([xyz])", "gyro", _RAD), (r"gF([xyz])", "accel", _G)),
    ),
    KnownTable(
        "OpenLog Artemis",
        (r"rtcTime|micros", r"aX", r"gX", r"imu_degC"),
        (
            (r"rtcTime", "time", ""),
            (r"g([XYZ])", "gyro", _DEG),
            (r"a([XYZ])", "accel", "mg"),
            (r"imu_degC", "temperature", "°C"),
        ),
    ),
    KnownTable(
        "Gyroflow's gcsv",
        (r"t",),
        ((r"t", "time", ""), (r"g([xyz])", "gyro", ""), (r"a([xyz])", "accel", "")),
        above=r"^(GYROFLOW|CAMERA) IMU LOG",
    ),
    KnownTable(
        "SensorLog for iOS",
        (r"accelerometerAccelerationX\(G\)",),
        (
            (r"accelerometerTimestamp_sinceReboot\(s\)", "time", "s"),
            (r"gyroRotation([XYZ])\(rad/s\)", "gyro", _RAD),
            (r"accelerometerAcceleration([XYZ])\(G\)", "accel", _G),
        ),
    ),
)


_NCLT = ("utime", "mag_x", "mag_y", "mag_z", "accel_x", "accel_y", "accel_z", "rot_x", "rot_y", "rot_z")
_KAIST = (
    "timestamp", "q_x", "q_y", "q_z", "q_w", "Eul_x", "Eul_y", "Eul_z", "Gyr_x", "Gyr_y", "Gyr_z",
    "Acc_x", "Acc_y", "Acc_z", "Mag_x", "Mag_y", "Mag_z",
)  # fmt: skip
_NAMELESS = {"ms25.csv": _NCLT, "xsens_imu.csv": _KAIST}
"""Column names of public data sets without header, by file name: NCLT (its description) and KAIST Urban."""


def names_by_file(path: Path, columns: int) -> tuple[str, ...]:
    """Return the names of the columns of a file without a header, by the name of the file; () if it is not known."""
    names = _NAMELESS.get(path.name, ())
    return names if len(names) == columns else ()


def known_table(names: Sequence[str], path: Path, above: Sequence[str]) -> tuple[str, Mapping[int, tuple[str, str]]]:
    """Recognise a table by its names and the lines `above`; return program ("" if unknown), and role and unit by
    column.

    >>> known_table(["TimeUS", "I", "GyrX"], Path("a.csv"), [])[1]
    {0: ('time', 'us'), 2: ('gyro_x', 'rad/s')}
    """
    head = "\n".join(above)
    for table in _TABLES:
        fits = all(any(re.fullmatch(pattern, name) for name in names) for pattern in table.needed)
        if fits and re.search(table.file, path.stem) and re.search(table.above, head):
            return table.program, _roles(table, names)
    return "", {}


def stated_scales(above: Sequence[str]) -> dict[str, tuple[str, float]]:
    """Return unit and scale of the sensors and of the time, from the lines above a decoded blackbox log or in a gcsv
    file. A gyro_scale of 1.0 is that of numbers in deg/s (Betaflight's blackbox-log-viewer, FlightLog).

    >>> stated_scales(['"acc_1G","2048"', '"gyro_scale","0x3f800000"'])
    {'accel': ('g', 0.00048828125), 'gyro': ('deg/s', 1.0)}
    >>> stated_scales(["tscale,0.001", "gscale,0.00122"])
    {'gyro': ('rad/s', 0.00122), 'time': ('ms', 1.0)}
    """
    text, units = "\n".join(above), dict[str, tuple[str, float]]()
    if gravity := re.search(r"\bacc_1G\W+(\d+)", text):
        units["accel"] = ("g", 1 / (int(gravity[1]) or 1))
    if re.search(r"\bgyro_scale\W+(?:0x3f800000|1\.0*\b)", text):
        units["gyro"] = ("deg/s", 1.0)
    scales = {key: float(number) for key, number in re.findall(r"(?m)^([tga])scale,(\d[\d.]*(?:e-?\d+)?)", text)}
    units |= {
        role: (unit, scales[key]) for key, role, unit in (("g", "gyro", _RAD), ("a", "accel", _G)) if key in scales
    }
    unit = next((unit for unit, count in TIME_UNITS.items() if round(count * scales.get("t", 0.0), 6) == 1), "")
    return units | ({"time": (unit, 1.0)} if unit else {})


def _roles(table: KnownTable, names: Sequence[str]) -> dict[int, tuple[str, str]]:
    roles: dict[str, tuple[int, str]] = {}
    for pattern, role, unit in table.columns:
        matches = [(k, match) for k, name in enumerate(names) if (match := re.fullmatch(pattern, name))]
        taken = {label for label, _ in roles.items()}
        for k, match in matches:
            axis = match[1].lower() if match.re.groups else ""
            full = f"{role}_{_AXIS.get(axis, axis)}" if axis else role
            if full not in taken:
                roles.setdefault(full, (k, unit))
    return {k: (role, unit) for role, (k, unit) in sorted(roles.items(), key=lambda item: item[1][0])}
