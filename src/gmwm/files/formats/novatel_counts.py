"""Sizes of the raw counts of IMUs in the logs of NovAtel receivers, by the type of the IMU.

Source: NovAtel, OEM7 Commands and Logs Reference Manual, "RAWIMUSX", table "Raw IMU scale factors"; the same factors
are in oem7_imu.cpp of novatel_oem7_driver. Most types log increments (rad, m/s); Epson's log rates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

_DEGREE, _FOOT = math.pi / 180, 0.3048


@dataclass(frozen=True)
class CountScale:
    """Size of a count of an IMU, for gyroscopes and accelerometers, in `units`."""

    name: str
    sizes: tuple[float, float]
    increments: bool = True
    units: tuple[str, str] = ("rad/s", "m/s²")


_HG1700 = (2.0**-33, 2.0**-27 * _FOOT)
_KVH = (0.1 / (3600 * 256), 0.05 / 2**15)
_FINE = (1e-9, 2e-8)
_STIM = CountScale("STIM300", (2.0**-21 * _DEGREE, 2.0**-22))
_HG4930 = CountScale("HG4930", (2.0**-33, 2.0**-29))
_G320 = CountScale("EPSON_G320", (0.008 / 2**16, 0.2 / 2**16), increments=False, units=("deg/s", "mg"))
TYPES = {
    "1": CountScale("HG1700_AG11", _HG1700),
    "4": CountScale("HG1700_AG17", (2.0**-33, 2.0**-26 * _FOOT)),
    "5": CountScale("HG1900_CA29", _HG1700),
    "8": CountScale("LN200", (2.0**-19, 2.0**-14)),
    "11": CountScale("HG1700_AG58", _HG1700),
    "12": CountScale("HG1700_AG62", (2.0**-33, 2.0**-26 * _FOOT)),
    "13": CountScale("IMAR_FSAS", (0.1 / 2**8 * _DEGREE / 3600, 0.05 / 2**15)),
    "16": CountScale("KVH_COTS", _KVH),
    "20": CountScale("HG1930_AA99", _HG1700),
    "26": CountScale("ISA100C", _FINE),
    "27": CountScale("HG1900_CA50", _HG1700),
    "28": CountScale("HG1930_CA50", _HG1700),
    "31": CountScale("ADIS16488", (720 / 2**31 * _DEGREE, 200 / 2**31)),
    "32": _STIM,
    "33": CountScale("KVH_1750", _KVH),
    "41": _G320,
    "52": CountScale("LITEF_MICROIMU", _FINE),
    "56": _STIM,
    "58": _HG4930,
    "61": CountScale("EPSON_G370", (0.0151515 / 2**16, 0.4 / 2**16), increments=False, units=("deg/s", "mg")),
    "62": _G320,
    "68": _HG4930,
    "69": _HG4930,
}
"""Types by the number in the logs RAWIMUX and RAWIMUSX."""
