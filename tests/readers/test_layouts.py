"""Files of loggers, written as their public descriptions state: each is read without options, or asks one question.

Each layout names its source. The numbers are converted to the unit of the file by plain factors, not by the package.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta
from functools import reduce

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import GmwmWarning, ReadError
from gmwm.base.units import find_unit
from tests.helpers import only, raises

DEG, G = math.pi / 180, 9.80665
RATE, SIZE = 100.0, 64
_RNG = np.random.default_rng(7)
GYRO = np.round(0.01 * _RNG.normal(size=(SIZE, 3)) + [0.02, -0.01, 0.003], 6)
ACCEL = np.round(0.02 * _RNG.normal(size=(SIZE, 3)) + [0.11, -0.07, 9.79], 5)


@dataclass(frozen=True)
class Layout:
    """A layout of a program or device: its source, and the text of a file with the recording above."""

    name: str
    source: str
    text: Callable[[], str]
    file: str = "log.csv"
    remarks: tuple[str, ...] = ()  # codes of remarks that say how the file was read
    sensors: tuple[str, ...] = ("gyro", "accel")
    options: dict[str, object] = field(default_factory=dict)
    tolerance: float = 1e-9
    encoding: str = "utf-8"


def moment(k: int) -> datetime:
    """Return the time of a sample; noon is in the recording."""
    return datetime(2024, 5, 13, 11, 59, 59, 700_000) + timedelta(milliseconds=10 * k)


def table(header: str, row: str = "{t:.3f},{g},{a}", *, deg=False, g=False, head="", scale=(1.0, 1.0), stamp=None):
    """Return the text of a table: a header and rows with the time, gyroscopes and accelerometers."""
    gyro = GYRO / (DEG if deg else 1.0) / scale[0]
    accel = ACCEL / (G if g else 1.0) / scale[1]
    separator = next(mark for mark in ",;\t " if mark in row)

    def write() -> str:
        rows = (
            row.format(
                k=k, s=stamp(moment(k)) if stamp else "", t=k / RATE,
                ns=k * 10_000_000, us=k * 10_000, ms=k * 10, wall=1_700_000_000 + k / RATE,
                G=gyro[k].tolist(), A=accel[k].tolist(),
                g=separator.join(map(repr, gyro[k].tolist())), a=separator.join(map(repr, accel[k].tolist())),
            )
            for k in range(SIZE)
        )  # fmt: skip
        return head + header + "\n" + "\n".join(rows) + "\n"

    return write


NAMES = [
    Layout("units spelled out", "a public thread: CSV of a CircuitPython logger",
           table("time_s,gyro_x_deg_per_s,gyro_y_deg_per_s,gyro_z_deg_per_s,accel_x_g,accel_y_g,accel_z_g", deg=True,
                 g=True)),
    Layout("raw_angular_rate", "a public thread: CSV of a MicroPython logger",
           table("timestamp_seconds,raw_angular_rate_x_deg_per_s,raw_angular_rate_y_deg_per_s,raw_angular_rate_z_deg_per_s,"
                 "raw_acceleration_x_gs,raw_acceleration_y_gs,raw_acceleration_z_gs", deg=True, g=True)),
    Layout("rad_per_s and m_per_s2", "names of pandas exports of ROS bags",
           table("t_s,gyro_x_rad_per_s,gyro_y_rad_per_s,gyro_z_rad_per_s,accel_x_m_per_s2,accel_y_m_per_s2,"
                 "accel_z_m_per_s2")),
    Layout("[dps] and [mg]", "ST Unicleo and MEMS Studio CSV",
           table("T [ms],ACC_X [mg],ACC_Y [mg],ACC_Z [mg],GYR_X [dps],GYR_Y [dps],GYR_Z [dps]", "{ms},{a},{g}",
                 deg=True, g=True, scale=(1.0, 1e-3))),
    Layout("mdps in names", "ST FP-SNS-DATALOG1",
           table("Time_s,G_x_mdps,G_y_mdps,G_z_mdps,A_x_mg,A_y_mg,A_z_mg", deg=True, g=True, scale=(1e-3, 1e-3))),
    Layout("unit before the axis", "names of MATLAB tables",
           table("time_s,gyro_dps_x,gyro_dps_y,gyro_dps_z,acc_mps2_x,acc_mps2_y,acc_mps2_z", deg=True)),
    Layout("a letter and a unit", "names of pandas columns of a split array",
           table("time_s,x_dps,y_dps,z_dps,x_g,y_g,z_g", deg=True, g=True)),
    Layout("a unit and a letter", "the same, with the unit first",
           table("time_s,mps2_x,mps2_y,mps2_z,dps_x,dps_y,dps_z", "{t:.3f},{a},{g}", deg=True)),
    Layout("ft/s² and °/hr", "Honeywell HG-series test sheets",
           table("time (s),gyro_x (°/hr),gyro_y (°/hr),gyro_z (°/hr),acc_x (ft/s²),acc_y (ft/s²),acc_z (ft/s²)",
                 deg=True, scale=(1 / 3600, 0.3048))),
    Layout("micro units with Greek letters", "navigation-grade loggers",
           table("time (s),gyro_x (μrad/s),gyro_y (μrad/s),gyro_z (μrad/s),acc_x (μg),acc_y (μg),acc_z (μg)", g=True,
                 scale=(1e-6, 1e-6))),
    Layout("camel case", "names of C# loggers",
           table("TimeMs;GyroXDegPerSec;GyroYDegPerSec;GyroZDegPerSec;AccelXms2;AccelYms2;AccelZms2", "{ms};{g};{a}",
                 deg=True)),
    Layout("inverse powers", "units of the EuRoC data sets, with raised digits",
           table("time [s],ω_x [rad s⁻¹],ω_y [rad s⁻¹],ω_z [rad s⁻¹],a_x [m·s⁻²],a_y [m·s⁻²],a_z [m·s⁻²]")),
    Layout("p, q, r", "state names of Etkin, Dynamics of Flight; JSBSim output",
           table("sys_time [s],p [deg/s],q [deg/s],r [deg/s],Ax [m/s2],Ay [m/s2],Az [m/s2]", deg=True),
           remarks=("left-out",)),
    Layout("tx, ty, tz beside wx", "issue of an Allan variance tool: a table of t and w",
           table("time_s,wx_rad_s,wy_rad_s,wz_rad_s,tx_m_s2,ty_m_s2,tz_m_s2"), remarks=("left-out",)),
    Layout("roll, pitch and yaw rate", "MAVLink ATTITUDE: rollspeed, pitchspeed, yawspeed (rad/s)",
           table("time_boot_ms,rollspeed (rad/s),pitchspeed (rad/s),yawspeed (rad/s),xacc (m/s2),yacc (m/s2),"
                 "zacc (m/s2)", "{ms},{g},{a}"), remarks=("left-out",)),
    Layout("axes by number", "pandas columns of a split array",
           table("time_s,gyro_0 (rad/s),gyro_1 (rad/s),gyro_2 (rad/s),acc_0 (m/s2),acc_1 (m/s2),acc_2 (m/s2)"),
           remarks=("left-out",)),
    Layout("a prefix of all axes", "SD loggers of rockets: imu_ax, imu_gx",
           table("time_s,imu_ax_ms2,imu_ay_ms2,imu_az_ms2,imu_gx_dps,imu_gy_dps,imu_gz_dps", "{t:.3f},{a},{g}",
                 deg=True), remarks=("left-out",)),
    Layout("linear acceleration beside", "LP-Research LpmsControl; also BNO055 loggers",
           table("SensorId, TimeStamp (s), FrameNumber, AccX (g), AccY (g), AccZ (g), GyroX (deg/s), GyroY (deg/s), "
                 "GyroZ (deg/s), LinAccX (g), LinAccY (g), LinAccZ (g)", "1, {t:.4f}, {k}, {a}, {g}, 0.1, 0.2, 0.{k}",
                 deg=True, g=True)),
    Layout("d/s and quoted blanks", "Axivity AX6, omconvert",
           table("Time,Accel-X (g), Accel-Y (g), Accel-Z (g), Gyro-X (d/s), Gyro-Y (d/s), Gyro-Z (d/s)",
                 "{s:%Y-%m-%d %H:%M:%S.%f},{a},{g}", deg=True, g=True, stamp=lambda time: time),
           remarks=("time-read",)),
    Layout("channels by number", "OpenBCI GUI, text with its settings in comments",
           table("Sample Index, EXG Channel 0, Accel Channel 0, Accel Channel 1, Accel Channel 2, Timestamp",
                 "{k}, 0.{k}, {a}, {wall:.6f}", g=True, head="%OpenBCI Raw EXG Data\n%Sample Rate = 100 Hz\n"),
           sensors=("accel",), remarks=("left-out",), options={"units": {"accel": "g"}}),
    Layout("a row of units, not all known", "Shimmer3, Consensys",
           table("S_1_Timestamp_Unix_CAL\tS_1_Accel_LN_X_CAL\tS_1_Accel_LN_Y_CAL\tS_1_Accel_LN_Z_CAL\tS_1_Gyro_X_CAL\t"
                 "S_1_Gyro_Y_CAL\tS_1_Gyro_Z_CAL\tS_1_Mag_X_CAL\t\nms\tm/(s^2)\tm/(s^2)\tm/(s^2)\tdeg/s\tdeg/s\tdeg/s\t"
                 "local_flux\t", "{ms}\t{a}\t{g}\t0.{k}\t", deg=True, head='"sep=\t"\n')),
    Layout("a time column without values", "TotalCapture, table of Xsens sensors",
           table("PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z", "{k},,{a},{g}"),
           options={"rate": RATE, "units": {"gyro": "rad/s", "accel": "m/s2"}}),
    Layout("vectors of a timetable", "MATLAB, writetimetable of messages of ROS",
           table("Time,AngularVelocity_1,AngularVelocity_2,AngularVelocity_3,LinearAcceleration_1,LinearAcceleration_2,"
                 "LinearAcceleration_3", "{t:.2f} sec,{g},{a}"), remarks=("left-out",),
           options={"units": {"gyro": "rad/s", "accel": "m/s2"}}),
    Layout("semicolons behind commas", "WISDM, raw accelerometers of phones",
           table("user,activity,timestamp,x,y,z;", "33,Jogging,{ns},{a};"), sensors=("accel",),
           options={"columns": {"time": 2, "accel_x": 3, "accel_y": 4, "accel_z": 5}, "units": {"accel": "m/s2"}}),
    Layout("a size before the unit", "x-io x-BIMU Logger",
           table("time (ms),gyroscope x (0.1 deg/s),gyroscope y (0.1 deg/s),gyroscope z (0.1 deg/s),"
                 "accelerometer x (mg),accelerometer y (mg),accelerometer z (mg),packet counter", "{ms},{g},{a},{k}",
                 deg=True, g=True, scale=(0.1, 1e-3)), remarks=("unit-named",)),
    Layout("a blank within a cell, tabs between", "WitMotion SDK, recorded data",
           table("Chiptime\tax(g)\tay(g)\taz(g)\twx(rad/s)\twy(rad/s)\twz(rad/s)\tmagx",
                 "2022-7-12 11:0:0:{k}\t{a}\t{g}\t0.{k}", g=True), options={"rate": RATE}),
    Layout("x-IMU with its packet number", "x-io x-IMU GUI, CalInertialAndMag.csv",
           table("Packet number,Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s),Accelerometer X (g),"
                 "Accelerometer Y (g),Accelerometer Z (g)", "{k},{g},{a}", deg=True, g=True, head="Sample rate: 100\n"),
           remarks=("rate-stated",)),
    Layout("Fs in the preamble", "exports of LabVIEW and of test benches",
           table("sample,ax [g],ay [g],az [g],gx [dps],gy [dps],gz [dps]", "{k},{a},{g}", deg=True, g=True,
                 head="Fs,100\nn_samples,64\n"), remarks=("rate-stated",)),
    Layout("interval in the preamble", "spreadsheets of data acquisition: dt",
           table("ax [g],ay [g],az [g],gx [dps],gy [dps],gz [dps]", "{a},{g}", deg=True, g=True,
                 head="# Sample interval (ms): 10\n"), remarks=("rate-stated",)),
    Layout("week and seconds in one cell", "GPS time tags of Inertial Explorer, week:seconds",
           lambda: table("GPS time,gx (deg/s),gy (deg/s),gz (deg/s),ax (g),ay (g),az (g)",
                         "2190:34560{t:.3f},{g},{a}", deg=True, g=True)(), remarks=("time-read",)),
]  # fmt: skip


def sentences(body: Callable[[int, str, str], str], *, deg=False, sign="$", before="", crc=False):
    """Return the text of a log of sentences. `body` returns a sentence for a sample without its checksum."""

    def write() -> str:
        lines = []
        for k in range(SIZE):
            gyro, accel = GYRO[k] / (DEG if deg else 1.0), ACCEL[k]
            text = body(k, ",".join(map(repr, gyro.tolist())), ",".join(map(repr, accel.tolist())))
            xor = reduce(lambda total, letter: total ^ ord(letter), text, 0)
            check = f"{zlib.crc32(text.encode(), 0xFFFFFFFF) ^ 0xFFFFFFFF:08x}" if crc else f"{xor:02X}"
            lines.append(before.format(t=f"{k / RATE:05.2f}") + sign + text + "*" + check)
            if k % 20 == 0:
                lines.append("$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47")
        return "\r\n".join(lines) + "\r\n"

    return write


def novatel(name: str, kind: str, *, types=("1e-9", "2e-8")):
    """Return a log of NovAtel with the increments of an ISA-100C in counts, in the order z, −y, x."""
    short = name.startswith("RAWIMUS")
    head = "1692,484620.664" if short else "COM1,0,81.5,FINESTEERING,1672,249869.003,02040000,3fdf,43495"

    def body(k: int, gyro: str, accel: str) -> str:
        counts = [
            np.rint(values[k] / RATE / float(size)).astype(int)
            for values, size in zip((ACCEL, GYRO), reversed(types), strict=True)
        ]
        values = ",".join(f"{row[2]},{-row[1]},{row[0]}" for row in counts)
        return f"{name},{head};{kind}1692,{484620 + k / RATE:.9f},00801503,{values}"

    return sentences(body, sign="%" if short else "#", crc=True)


def _clock(k: int) -> str:
    """Return the time of day of a sample; midnight is in the recording."""
    return f"2359{59.7 + k / RATE:06.3f}" if k < 30 else f"0000{k / RATE - 0.3:06.3f}"


SENTENCES = [
    Layout("VNYMR", "VectorNav VN-100 user manual: VNYMR",
           sentences(lambda k, g, a: f"VNYMR,+012.5,-000.4,-000.9,-00.15,+00.16,+00.30,{a},{g}"), "log.txt",
           remarks=("file-content", "left-out"), options={"rate": RATE}),
    Layout("VNIMU with the time of the logger", "VectorNav VN-100 user manual: VNIMU",
           sentences(lambda k, g, a: f"VNIMU,-00.03,+00.42,-00.66,{a},{g},+20.7,+084.322",
                     before="2024-05-01 12:00:{t} "), "log.txt", remarks=("file-content", "time-read")),
    Layout("VNQMR with seconds of the logger", "VectorNav VN-100 user manual: VNQMR",
           sentences(lambda k, g, a: f"VNQMR,-0.01,-0.00,+0.05,+0.99,+1.06,-0.25,+3.06,{a},{g}",
                     before="17000000{t},"), "log.txt", remarks=("file-content",)),
    Layout("PSBGI", "SBG Systems, sbgECom logs: SBG_ECOM_LOG_NMEA_1_PSBGI",
           sentences(lambda k, g, a: f"PSBGI,{_clock(k)},{g},{a},", deg=True), "log.txt",
           remarks=("file-content", "time-read")),
    Layout("PSONCMS", "Xsens MT low-level documentation: string output",
           sentences(lambda k, g, a: f"PSONCMS,0.0905,0.4217,0.9020,-0.0196,{a},{g},0.0581,0.3846,0.7421,33.1"),
           "log.txt", remarks=("file-content",), options={"rate": RATE}),
    Layout("PIMU", "Inertial Sense documentation: NMEA protocol, PIMU",
           sentences(lambda k, g, a: f"PIMU,{3218.5 + k / RATE:.3f},{g},{a}"), "log.txt", remarks=("file-content",)),
    Layout("GPSXT", "HiPNUC products: hipnuc_nmea_parser.py",
           sentences(lambda k, g, a: f"GPSXT,202303100905{29 + k / RATE:05.2f},116.4,39.9,158.2,359.8,-4.9,359.8,0.001,"
                     f"171.2,1,0,15,15,{g},-0.001,-0.000,0.002,8,0", deg=True), "log.txt", sensors=("gyro",),
           remarks=("file-content",), options={"units": {"gyro": "deg/s"}}),
    *(
        Layout(name, f"NovAtel OEM7 reference manual: {name}; factors in oem7_imu.cpp of novatel_oem7_driver",
               novatel(name + "A", "00,26," if name.endswith("X") else ""), "log.asc", remarks=("file-content",),
               options={} if name.endswith("X") else {"format": "novatel:ISA100C"}, tolerance=1e-5)
        for name in ("RAWIMU", "RAWIMUS", "RAWIMUX", "RAWIMUSX")
    ),
]  # fmt: skip
EXPORTS = [
    Layout("write.table of R", "R manual, write.table: a header one field short, and quoted names with blanks",
           lambda: r_table(['"gyro x [rad/s]"', '"gyro y [rad/s]"', '"gyro z [rad/s]"', '"acc x [g]"', '"acc y [g]"',
                            '"acc z [g]"'], g=True), "log.txt", options={"rate": RATE}),
    Layout("write.table of R with V1 to V6", "R manual, write.table: names of a matrix",
           lambda: r_table([f'"V{k}"' for k in range(1, 7)]), "log.txt",
           options={"rate": RATE, "units": {"gyro": "rad/s", "accel": "m/s2"},
                    "columns": ["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]}),
    Layout("save -ascii of MATLAB", "MATLAB documentation, save: ASCII format in a file named .mat",
           lambda: "".join(
               "".join(f"  {v: .16e}" for v in (k / RATE, *GYRO[k], *ACCEL[k])) + "\n" for k in range(SIZE)
           ),
           "data.mat", options={"units": {"gyro": "rad/s", "accel": "m/s2"},
                    "columns": ["time", "gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"]}),
]  # fmt: skip


def r_table(names: list[str], g=False) -> str:
    """Return the output of `write.table` of R with its defaults."""
    rows = ((*GYRO[k].tolist(), *(ACCEL[k] / (G if g else 1.0)).tolist()) for k in range(SIZE))
    return " ".join(names) + "\n" + "".join(f'"{k}" {" ".join(map(repr, row))}\n' for k, row in enumerate(rows, 1))


def long(label: dict[str, str], header: str, row: str) -> str:
    """Return one table of both sensors; the accelerometers come between the gyroscopes, and a magnetometer too."""
    lines = [header] if header else []
    for k in range(SIZE):
        for sensor, values, shift in (("gyro", GYRO, 0), ("accel", ACCEL, 3), ("mag", ACCEL, 5)):
            x, y, z = values[k].tolist()
            lines.append(row.format(label=label[sensor], ms=1_700_000_000_000 + 10 * k + shift, x=x, y=y, z=z))
    return "\n".join(lines) + "\n"


_ANDROID = {sensor: f"android.sensor.{name}" for sensor, name in
            (("gyro", "gyroscope"), ("accel", "accelerometer"), ("mag", "magnetic_field"))}  # fmt: skip
_WORDS = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
_HEX = ['"Product","Blackbox flight data recorder"', '"acc_1G","2048"', '"gyro_scale","0x3f800000"', '"looptime","125"']
TABLES = [
    *(
        Layout(f"long table of Android, {sensor}", "Android reference, SensorEvent: rad/s and m/s²",
               lambda: long(_ANDROID, "type,timestamp [ms],x,y,z", "{label},{ms},{x!r},{y!r},{z!r}"), sensors=(sensor,),
               options={"topic": _ANDROID[sensor]})
        for sensor in ("gyro", "accel")
    ),
    Layout("long table with values in order", "CSV of phone loggers: sensor, time, values",
           lambda: long(_WORDS, "sensor;time_ms;value1;value2;value3", "{label};{ms};{x!r};{y!r};{z!r}"),
           sensors=("gyro",), options={"topic": "Gyroscope", "units": {"gyro": "rad/s"}}),
    Layout("long table with units in the names of the sensors", "MetaMotion loggers: gyro_dps, accel_g",
           lambda: long({"gyro": "gyro_radps", "accel": "accel_ms2", "mag": "mag_ut"}, "epoch_ms,sensor,x,y,z",
                        "{ms},{label},{x!r},{y!r},{z!r}"),
           sensors=("gyro",), options={"topic": "gyro_radps"}),
    Layout("long table without header", "CSV of phone loggers",
           lambda: long(_WORDS, "", "{label},{ms},{x!r},{y!r},{z!r}"), sensors=("accel",),
           options={"topic": "Accelerometer", "units": {"accel": "m/s2"}}),
    Layout("decoded blackbox with its headers", "Betaflight blackbox-log-viewer: FlightLog, acc_1G and gyro_scale",
           table("loopIteration,time (us),axisP[0],gyroADC[0],gyroADC[1],gyroADC[2],accSmooth[0],accSmooth[1],"
                 "accSmooth[2]", "{k},{us},0,{g},{a}", deg=True, g=True, scale=(1.0, 1 / 2048),
                 head="\n".join([*_HEX, ""])),
           remarks=("file-content",)),
    Layout("NCLT", "description of the sensor data of NCLT: ms25.csv", lambda: "".join(
        f"{1_326_030_975_726_043 + 10_000 * k},-0.1,0.2,0.3,"
        f"{','.join(map(repr, [*ACCEL[k].tolist(), *GYRO[k].tolist()]))}\n"
        for k in range(SIZE)), "ms25.csv", remarks=("file-content",)),
    Layout("KAIST Urban", "data of KAIST Urban: xsens_imu.csv", lambda: "".join(
        f"{1_544_578_498_421_000_000 + 10_000_000 * k},0,0,0,1,0.1,0.2,0.3,"
        f"{','.join(map(repr, [*GYRO[k].tolist(), *ACCEL[k].tolist()]))},0.1,0.2,0.3\n"
        for k in range(SIZE)), "xsens_imu.csv", remarks=("file-content",)),
    Layout("TUM RGB-D", "file formats of the RGB-D benchmark of TUM: accelerometer.txt",
           lambda: "# accelerometer data\n# file: 'x.bag'\n# timestamp ax ay az\n" + "".join(
               f"{1305031449.5 + k / RATE:.4f} {' '.join(map(repr, ACCEL[k].tolist()))}\n" for k in range(SIZE)),
           "accelerometer.txt", sensors=("accel",), options={"units": {"accel": "m/s2"}}),
    Layout("EuRoC and TUM VI", "ASL data format: imu0/data.csv",
           table("#timestamp [ns],w_RS_S_x [rad s^-1],w_RS_S_y [rad s^-1],w_RS_S_z [rad s^-1],a_RS_S_x [m s^-2],"
                 "a_RS_S_y [m s^-2],a_RS_S_z [m s^-2]", "{ns},{g},{a}"), "data.csv"),
]  # fmt: skip
LAYOUTS = [*NAMES, *SENTENCES, *EXPORTS, *TABLES]


def test_folders_of_data_sets(tmp_path):
    (tmp_path / "seq" / "mav0" / "imu0").mkdir(parents=True)
    (tmp_path / "seq" / "mav0" / "imu0" / "data.csv").write_text(TABLES[-1].text())
    oxts = tmp_path / "drive" / "oxts"
    (oxts / "data").mkdir(parents=True)
    seconds = (f"2011-09-26 13:02:{k / RATE:012.9f}\n" for k in range(SIZE))
    (oxts / "timestamps.txt").write_text("".join(seconds))
    for k in range(SIZE):
        row = [0.0] * 11 + [*ACCEL[k].tolist(), 0.0, 0.0, 0.0, *GYRO[k].tolist()] + [0.0] * 10
        (oxts / "data" / f"{k:010d}.txt").write_text(" ".join(map(repr, row)))
    for folder in (tmp_path / "seq", tmp_path / "seq" / "mav0", tmp_path / "drive", oxts):
        imu = gmwm.read(folder)
        assert imu.rate == pytest.approx(RATE)
        assert np.array_equal(np.column_stack([imu[axis].values for axis in imu]), np.hstack([GYRO, ACCEL]))
    (oxts / "data" / "0000000003.txt").unlink()
    with raises(ReadError, 64, 63, code="files-missing"):
        gmwm.read(oxts)


def test_a_long_table_asks_for_the_sensor(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(TABLES[0].text())
    with raises(ReadError, code="several-recordings", advises=["topic="]):
        gmwm.read(path)


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_a_layout_is_read_without_options(tmp_path, layout, recwarn):
    require_recording(tmp_path / layout.file, layout)
    assert not recwarn.list


def require_recording(path, layout: Layout) -> None:
    """Require that the file of a layout holds the recording above, in memory and as a stream."""
    path.write_text(layout.text(), encoding=layout.encoding, newline="")
    imu = gmwm.read(path, **layout.options)
    assert imu.rate == pytest.approx(RATE, rel=1e-6)
    truth = {"gyro": GYRO, "accel": ACCEL}
    assert list(imu) == [f"{sensor}_{axis}" for sensor in layout.sensors for axis in "xyz"]
    for sensor in layout.sensors:
        values = np.column_stack([imu[f"{sensor}_{axis}"].values for axis in "xyz"])
        np.testing.assert_allclose(values, truth[sensor], rtol=layout.tolerance, atol=1e-12 * layout.tolerance / 1e-9)
    codes = [remark.code for remark in imu.remarks]
    assert [code for code in layout.remarks if code not in codes] == []
    stream = gmwm.stream(path, **layout.options)
    axis = f"{layout.sensors[0]}_x"
    assert np.concatenate([chunk.values[axis] for chunk in stream]).tolist() == imu[axis].values.tolist()


QUESTIONS = [
    ("a whole sensor is lost", "time_s,gyro_x_furlong,gyro_y_furlong,gyro_z_furlong,ax,ay,az", "columns-ambiguous",
     "accel_x:4,accel_y:5,accel_z:6,gyro_x:1,gyro_y:2,gyro_z:3,time:0"),
    ("mega-g is not milli-g", "time_s,gyro_x [dps],gyro_y [dps],gyro_z [dps],acc_x [Mg],acc_y [Mg],acc_z [Mg]",
     "unit-unknown", "units=accel:m/s²"),
    ("a range is not a unit", "# gyro range: 250.0 dps, accel range = 4 g\ntime_s,gx,gy,gz,ax,ay,az", "unit-unnamed",
     "gyro:rad/s"),
    ("the g of imu_gx is not a unit", "time_s,imu_gx,imu_gy,imu_gz,c,d,e", "no-inertial-data", "time,gyro_x,gyro_y"),
    ("not a message of ROS", "time_s,angular_velocity_x,angular_velocity_y,angular_velocity_z,acceleration_x,"
     "acceleration_y,acceleration_z", "unit-unnamed", "gyro:rad/s"),
    ("p and q without r", "time_s,p,q,wind", "no-inertial-data", "time,gyro_x,gyro_y,gyro_z"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("header", "code", "answer"), [row[1:] for row in QUESTIONS], ids=[row[0] for row in QUESTIONS]
)
def test_what_a_file_does_not_say_is_one_question(tmp_path, header, code, answer):
    path = tmp_path / "log.csv"
    path.write_text(table(header, "{t:.3f},{g},{a}" if header.count(",") > 3 else "{t:.3f},{g}")())
    with pytest.raises(gmwm.errors.ReadError) as caught:
        gmwm.read(path)
    assert caught.value.code == code
    assert answer in "".join(f"{key}={value}" for key, value in caught.value.facts.items()) + caught.value.advice


def test_the_example_of_the_option_counts_columns_of_numbers(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("".join(f"IMU,{k / RATE},{','.join(map(str, [*ACCEL[k], *GYRO[k]]))},ok\n" for k in range(SIZE)))
    with raises(ReadError, code="columns-unnamed") as caught:
        gmwm.read(path)
    assert caught.value.facts["example"] == ",time,accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z,"
    path.write_text("".join(f"a/g:\t{k % 9}\t7\t16384\t42\t-18\t17\n" for k in range(SIZE)))  # counts of i2cdevlib
    with raises(ReadError, code="columns-unnamed", example=",accel_x,accel_y,accel_z,gyro_x,gyro_y,gyro_z"):
        gmwm.read(path)
    path.write_text(r_table([f'"V{k}"' for k in range(1, 7)]))
    with raises(ReadError, code="no-inertial-data") as caught:
        gmwm.read(path)
    assert caught.value.facts["example"] == "gyro_x,gyro_y,gyro_z,accel_x,accel_y,accel_z"
    path.write_text(  # two units in one file
        "t," + ",".join(f"imu{unit}_{axis}" for unit in "01" for axis in ("gx", "gy", "gz", "ax", "ay", "az")) + "\n"
        + "".join(f"{k / RATE},{','.join(map(str, [*GYRO[k], *ACCEL[k]] * 2))}\n" for k in range(SIZE))
    )  # fmt: skip
    with raises(ReadError, code="columns-ambiguous") as caught:
        gmwm.read(path)
    assert caught.value.facts["example"] == "time:0,gyro_x:1,gyro_y:2,gyro_z:3,accel_x:4,accel_y:5,accel_z:6"


def test_one_axis_that_is_not_read_is_a_warning(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table("time_s,gyro_x [dps],gyro_y [dps],gyro_z_furlong,ax [g],ay [g],az [g]", deg=True, g=True)())
    with pytest.warns(GmwmWarning, match="gyro_z_furlong"):
        imu = gmwm.read(path)
    assert "gyro_x" in imu
    assert "gyro_z" not in imu
    gmwm.read(path, columns={"gyro_z": None})  # the user has decided: no warning


def test_a_damaged_sentence_is_a_lost_sample(tmp_path):
    text = SENTENCES[0].text().replace("+012.5", "+012.6", 3)  # wrong checksums
    lines = text.split("\r\n")
    lines[40] = lines[40][:30]  # cut
    lines[50] = lines[50][:20] + lines[51]  # two sentences in one line, the first without its end
    del lines[51]
    lines.insert(20, "boot ok, no sentence in this line")
    path = tmp_path / "log.txt"
    path.write_text("\r\n".join(lines))
    with pytest.warns(GmwmWarning, match="5 lost samples"):
        imu = gmwm.read(path, rate=RATE)
    assert only(imu.remarks, "log-dropouts:sentences").facts == {"case": "sentences", "name": "VNYMR", "count": 5}
    assert len(imu) == SIZE - 5


def test_the_type_of_an_imu_is_one_question(tmp_path):
    path = tmp_path / "log.asc"
    path.write_text(novatel("RAWIMUSA", "")())
    with raises(ReadError, code="sensor-ambiguous", advises=["novatel:ISA100C"]):
        gmwm.read(path)
    path.write_text(novatel("RAWIMUSXA", "00,99,")())
    with raises(ReadError, "99", code="sensor-ambiguous", advises=["novatel:ISA100C"]):
        gmwm.read(path)


def test_attitude_alone_is_no_recording(tmp_path):
    path = tmp_path / "log.txt"
    path.write_text(
        sentences(lambda k, g, a: f"PASHR,123816.{k:02d},312.95,T,-000.83,-000.42,-000.01,0.2,0.2,0.3,1,0")()
    )
    with raises(ReadError, "PASHR", code="no-inertial-data"):
        gmwm.read(path)
    path.write_text(novatel("RAWIMUSXA", "00,99,")().replace(",99,", ",98,"))
    with raises(ReadError, "with a wrong checksum", code="no-inertial-data"):
        gmwm.read(path)


def test_checksums_of_public_examples():
    """Examples of the OEM7 manual and of the documentation of sbgECom and go-nmea."""
    from gmwm.files.formats.sentences import _checksum

    example = (
        b"RAWIMUSXA,1692,484620.664;00,11,1692,484620.664389000,00801503,43110635,-817242,-202184,-215194,-41188,-9895"
    )
    assert _checksum(example, 8) == 0xA5DB8C7B
    assert _checksum(b"PSBGI,003944.74,-0.08,0.07,0.00,-0.02,0.06,-9.72,", 2) == 0x42


@pytest.mark.parametrize(
    ("texts", "name"),
    [
        ("deg/s|°/s|º/s|dps|DPS|d/s|deg_per_s|degps|degs|degrees per second|deg s^-1|deg·s⁻¹|Deg/Sec", "deg/s"),
        ("rad/s|RAD/S|rad_per_s|radps|radians/sec|rad.s^-1|rads-1", "rad/s"),
        ("mdps|mdeg/s|MDPS|milli_degrees_per_sec|m°/s", "mdeg/s"), ("µrad/s|μrad/s|urad/s", "µrad/s"),
        ("°/hr|deg/h|dph|degrees per hour", "deg/h"), ("rev/min|rpm", "rpm"),
        ("m/s²|m/s^2|m_per_s2|mps2|ms-2|m/s/s|metres per second squared|meters/sec^2", "m/s²"),
        ("ft/s²|ft/s^2|feet/s/s", "ft/s²"), ("g|gs|gees|g0|G", "g"), ("mg|mG|millig|milli-g", "mg"),
        ("µg|μg|ug|micro_g", "µg"), ("Gal", "cm/s²"),
        ("Mg|MG|Mrad/s|deg|rad|m/s|s|cg|furlong/s|deg/s/s|m/s3|gauss|per_s|" + "m" * 1000, None),
    ],
)  # fmt: skip
def test_the_grammar_of_units(texts, name):
    for text in texts.split("|"):
        unit = find_unit(text)
        assert (unit.name if unit else None) == name, text
