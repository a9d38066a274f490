"""Read logs of sentences of inertial sensors: NMEA sentences such as $VNYMR,…*68, and the ASCII logs of NovAtel.

Sentences with a wrong checksum are lost samples; others, such as $GPGGA, are left out. Sources: VectorNav VN-100 user
manual, "ASCII output messages"; SBG Systems sbgECom, "NMEA proprietary"; Xsens MT low-level documentation, "String
output"; Inertial Sense, "NMEA protocol"; HiPNUC, hipnuc_nmea_parser.py; NovAtel, OEM7 Commands and Logs Reference
Manual, "RAWIMUSX", "Raw IMU scale factors" (also oem7_imu.cpp of novatel_oem7_driver)."""

from __future__ import annotations

import math
import re
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.template import join_names
from gmwm.base.units import STANDARD_GRAVITY, parse_unit
from gmwm.files.clock.missing_values import MISSING
from gmwm.files.clock.text_stamps import form_remark, is_stamp, times_of
from gmwm.files.contract import CHUNK_ROWS, Channel, Layout, Reader, Rows, register

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


_NEAR_GRAVITY = 0.1  # relative agreement with gravity of types that are proposed; their counts differ by 1.5 or more
_LINE_BYTES = 1 << 12  # longer lines are no sentences
_START = re.compile(rb"[$#%!]([A-Z][A-Z0-9]{2,15}),")
_SENTENCE = re.compile(rb"[$#%!]([A-Z][A-Z0-9]{2,15}),([^*]*)\*([0-9A-Fa-f]{8}|[0-9A-Fa-f]{2})\s*")


@dataclass(frozen=True)
class Sentence:
    """The fields of a sentence: the index of the first field of each sensor, and their units."""

    program: str
    gyro: int | None = None
    accel: int | None = None
    time: str = ""  # form of the time in the field `time_field`: "s", "clock" (hhmmss), "date" or "week"; "" for none
    time_field: int = 0
    temperature: int | None = None
    units: tuple[str, str] = ("rad/s", "m/s²")
    counts: bool = False  # whether the values are counts of NovAtel, in the order z, −y, x
    imu_type: int | None = None  # index of the field with the type of the IMU, which determines the size of a count

    def place(self, axis: str) -> int:
        """Return the index of the field of an axis, such as "gyro_x"."""
        sensor, letter = axis.split("_")
        first = self.gyro if sensor == "gyro" else self.accel
        return (first or 0) + ("zyx" if self.counts else "xyz").index(letter)


_VN, _SXT = "VectorNav's ASCII output", "HiPNUC's SXT"
SENTENCES = {
    "VNIMU": Sentence(_VN, gyro=6, accel=3, temperature=9),
    "VNCMV": Sentence(_VN, gyro=6, accel=3, temperature=9),
    "VNYMR": Sentence(_VN, gyro=9, accel=6),
    "VNQMR": Sentence(_VN, gyro=10, accel=7),
    "VNQAR": Sentence(_VN, gyro=7, accel=4),
    "VNMAR": Sentence(_VN, gyro=6, accel=3),
    "VNISL": Sentence(_VN, gyro=12, accel=9),
    "VNGYR": Sentence(_VN, gyro=0),
    "VNACC": Sentence(_VN, accel=0),
    "PSBGI": Sentence("SBG's PSBGI", gyro=1, accel=4, time="clock", units=("deg/s", "m/s²")),
    "PSONCMS": Sentence("Xsens' PSONCMS", gyro=7, accel=4, temperature=13),
    "PRIMU": Sentence("Inertial Sense's PRIMU", gyro=1, accel=4, time="s"),
    "PIMU": Sentence("Inertial Sense's PIMU", gyro=1, accel=4, time="s"),
    "GPSXT": Sentence(_SXT, gyro=13, time="date", units=("", "")),
    "GNSXT": Sentence(_SXT, gyro=13, time="date", units=("", "")),
    "RAWIMUSXA": Sentence("NovAtel's RAWIMUSX", 8, 5, time="week", time_field=2, counts=True, imu_type=1),
    "RAWIMUXA": Sentence("NovAtel's RAWIMUX", 8, 5, time="week", time_field=2, counts=True, imu_type=1),
    "RAWIMUSA": Sentence("NovAtel's RAWIMUS", 6, 3, time="week", counts=True),
    "RAWIMUA": Sentence("NovAtel's RAWIMU", 6, 3, time="week", counts=True),
}
"""The sentences with rates or accelerations. The first one that a file holds is read if the user chooses none."""


@dataclass(frozen=True)
class _State:
    """Name of a recording's sentence, the logger's stamp before the first one ("" for none), and number of fields."""

    name: str
    stamp: str
    width: int


class _SentenceFormat(Reader):
    """Base class of the readers of sentences."""

    scale: ClassVar[CountScale | None] = None  # the size of the counts, if the user names the type of the IMU

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return one recording for each sentence with rates or accelerations."""
        counts, damaged, firsts = Counter[str](), Counter[str](), dict[str, tuple[str, list[str]]]()
        for stamp, name, fields in _sentences(path):
            if fields is None:
                damaged[name] += 1
                continue
            counts[name] += 1
            if name not in firsts:
                firsts[name] = stamp, fields.decode("latin-1").split(",")
        names = [name for name in SENTENCES if counts[name]]
        others = tuple(f"{name} ({count})" for name, count in counts.most_common(8) if name not in SENTENCES)
        if not names:
            others += tuple(f"{name} ({count} with a wrong checksum)" for name, count in damaged.most_common(8))
            raise ReadError(
                f"{path} holds no sentence with angular rates or accelerations. Its sentences: "
                f"{join_names(list(others)) or 'none'}",
                code="no-inertial-data",
                advice="Let the device write its inertial data, for example VNYMR, PSBGI or RAWIMUSXA.",
            )
        layouts = []
        for name in names:
            lost = (
                (Remark.of("log-dropouts", case="sentences", name=name, count=damaged[name]),) if damaged[name] else ()
            )
            left_out = (Remark.of("left-out", case="names", kind="sentences", names=others),) if others else ()
            layout = self._layout(path, name, *firsts[name])
            topic = name if len(names) > 1 else ""
            remarks = (*layout.remarks, *lost, *left_out)
            layouts.append(replace(layout, topic=topic, preferred=name == names[0], remarks=remarks))
        return tuple(layouts)

    def _layout(self, path: Path, name: str, stamp: str, fields: list[str]) -> Layout:
        """Return the columns of a sentence, given the time stamp and the fields of the first one."""
        kind, program = SENTENCES[name], SENTENCES[name].program
        units, scales, increments, remarks = kind.units, (1.0, 1.0), False, []
        if kind.counts:
            scale = self.scale or (TYPES.get(fields[kind.imu_type]) if kind.imu_type is not None else None)
            if scale is None:
                raise _unknown_type(path, name, fields)
            units, scales, increments = scale.units, scale.sizes, scale.increments
            program = f"{program} of {scale.name}"
        if not (is_stamp(stamp) or re.fullmatch(r"\d+(\.\d+)?", stamp) is not None) or kind.time:
            stamp = ""
        channels = []
        if kind.time or stamp:
            dated = kind.time in ("clock", "date", "week") or is_stamp(stamp)
            channels.append(Channel("time", "ns" if dated else kind.time, "time"))
            remarks += [form_remark(stamp)] if is_stamp(stamp) else []
        for sensor, first, unit, size in zip(("gyro", "accel"), (kind.gyro, kind.accel), units, scales, strict=True):
            for letter in "xyz" if first is not None else "":
                sign = -1.0 if kind.counts and letter == "y" else 1.0
                axis = f"{sensor}_{letter}"
                channels.append(Channel(axis, unit, axis=axis, increments=increments, scale=sign * size))
        if kind.temperature is not None and kind.temperature < len(fields):
            channels.append(Channel("temperature", "°C", "temperature"))
        first_row = tuple(stamp if c.axis == "time" else fields[_field(kind, c.axis)] for c in channels)
        remarks.insert(0, Remark.of("file-content", case="layout", format=program))
        return Layout(tuple(channels), first_row, remarks=tuple(remarks), state=_State(name, stamp, len(fields)))

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the values of the sentences; missing values for a sentence that is damaged."""
        state: _State = layout.state
        kind = SENTENCES[state.name]
        sentences = (sentence for sentence in _sentences(path) if sentence[1] == state.name)
        while rows := list(islice(sentences, CHUNK_ROWS)):
            table = _table([fields for _, _, fields in rows], state.width)
            roles = {k: layout.channels[k].axis for k in wanted}
            yield {
                k: _times(table, [stamp for stamp, _, _ in rows], state) if role == "time"
                else _numbers(table, _field(kind, role))
                for k, role in roles.items()
            }  # fmt: skip


@register
class SentenceReader(_SentenceFormat):
    """Reader of sentences whose units the sentence determines."""

    name: ClassVar[str] = "sentences"
    extensions: ClassVar[tuple[str, ...]] = (".txt", ".log", ".nmea", ".asc", ".gps")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.95 if most lines are sentences."""
        lines = [line for line in head.split(b"\n")[:-1] if line.strip()][:200] or [head]
        return 0.95 if 2 * sum(_SENTENCE.search(line) is not None for line in lines) > len(lines) else 0.0


for _scale in dict.fromkeys(TYPES.values()):
    register(
        type(
            f"Novatel{_scale.name}Reader", (_SentenceFormat,),
            {"name": f"novatel:{_scale.name}", "scale": _scale, "__module__": __name__,
             "__doc__": f"Reader of the raw counts of a {_scale.name} in logs of NovAtel."},
        )
    )  # fmt: skip


def _sentences(path: Path) -> Iterator[tuple[str, str, bytes | None]]:
    """Yield the text before each sentence of a log, its name and its fields; None for the fields if it is damaged."""
    with path.open("rb") as file:
        while line := file.readline(_LINE_BYTES):
            starts = [match.start() for match in _START.finditer(line)]
            if not starts:
                continue
            before = line[: starts[0]].strip(b" ,;\t->").decode("latin-1")
            for begin, end in zip(starts, [*starts[1:], len(line)], strict=True):
                piece = line[begin:end]
                match, name = _SENTENCE.fullmatch(piece), piece[1 : piece.index(b",")].decode()
                # A log of NovAtel has a header that ends with a semicolon.
                if match and _checksum(piece[1 : piece.index(b"*")], len(match[3])) == int(match[3], 16):
                    yield before, name, match[2].rpartition(b";")[2]
                else:
                    yield before, name, None


def _checksum(text: bytes, digits: int) -> int:
    """Return the XOR of bytes (NMEA), or NovAtel's CRC-32 from 0, not inverted (OEM7 manual, "32-bit CRC")."""
    if digits == 8:
        return zlib.crc32(text, 0xFFFFFFFF) ^ 0xFFFFFFFF
    total, bits = int.from_bytes(text, "big"), 4 * (1 << (len(text) - 1).bit_length())
    while bits >= 8:  # the XOR of both halves
        total, bits = total ^ (total >> bits), bits // 2
    return total & 0xFF


def _field(kind: Sentence, role: str) -> int:
    """Return the index of the field with an axis, or with the temperature."""
    return (kind.temperature or 0) if role == "temperature" else kind.place(role)


def _table(rows: list[bytes | None], width: int) -> Any:
    """Return the fields of sentences as columns of text; null in a row without the right number of fields."""
    import polars as pl

    empty = b"," * (width - 1)
    lines = [empty if row is None or row.count(b",") != width - 1 else row for row in rows]
    schema = {str(k): pl.String for k in range(width)}
    return pl.read_csv(b"\n".join([*lines, b""]), has_header=False, schema=schema, quote_char=None)


def _numbers(table: Any, k: int) -> NDArray[np.float64]:
    """Return a column of numbers; NaN for a missing value, and for text that is not a number."""
    import polars as pl

    numbers: NDArray[np.float64] = table[str(k)].cast(pl.Float64, strict=False).to_numpy()
    return numbers


def _times(table: Any, stamps: list[str], state: _State) -> NDArray[Any]:
    """Return the time stamps: nanoseconds, or seconds in the sentence, or numbers that the logger wrote before it."""
    import polars as pl

    kind = SENTENCES[state.name]
    if state.stamp and not is_stamp(state.stamp):
        return np.asarray(pl.Series(stamps).cast(pl.Float64, strict=False).to_numpy())
    if state.stamp:
        return times_of(pl.Series(stamps), state.stamp).view(np.int64)
    first = _numbers(table, kind.time_field)
    if kind.time == "s":
        return first
    if kind.time == "week":
        days, seconds = 7 * first, _numbers(table, kind.time_field + 1)
    else:
        text = table[str(kind.time_field)]
        days = np.zeros(text.len())
        if kind.time == "date":
            dates = text.str.head(8).str.to_date("%Y%m%d", strict=False)
            days, text = dates.to_physical().cast(pl.Float64).to_numpy(), text.str.slice(8)
        clock = text.cast(pl.Float64, strict=False).to_numpy()
        seconds = 3600 * (clock // 10_000) + 60 * (clock // 100 % 100) + clock % 100
    with np.errstate(invalid="ignore"):
        nanoseconds = np.rint(1e9 * seconds).astype(np.int64) + 86_400 * 10**9 * days.astype(np.int64)
    return np.where(np.isfinite(seconds + days), nanoseconds, MISSING)


def _unknown_type(path: Path, name: str, fields: list[str]) -> ReadError:
    """Make the error for counts of an IMU whose type is not known. It names the types whose counts fit gravity."""
    kind = SENTENCES[name]
    stated = f" of type {fields[kind.imu_type]}, which gmwm does not know" if kind.imu_type is not None else ""
    rows = list(islice((row for row in _sentences(path) if row[1] == name), 1000))
    table = _table([row for _, _, row in rows], len(fields))
    times = _times(table, [], _State(name, "", len(fields)))
    counts = float(np.linalg.norm([np.nanmean(_numbers(table, kind.place(f"accel_{axis}"))) for axis in "xyz"]))
    rate = 1e9 / max(float(np.median(np.diff(times[times != MISSING]))), 1.0) if times.size > 1 else 1.0
    norms = {
        scale.name: counts * scale.sizes[1] * parse_unit(scale.units[1], "accel").factor * (rate**scale.increments)
        for scale in TYPES.values()
    }
    fitting = [label for label, norm in norms.items() if abs(norm / STANDARD_GRAVITY - 1) < _NEAR_GRAVITY]
    return ReadError(
        f"{path} holds counts of an IMU{stated}, and {kind.program} does not state their size",
        code="sensor-ambiguous",
        argument="format",
        advice="Name the IMU with {--format}. "
        + ("These fit gravity: {formats}." if fitting else "One of: {formats}."),
        formats=", ".join(f"novatel:{label}" for label in fitting or norms),
    )
