"""Files of loggers, written as their public descriptions state: each is read without options, or asks one question.

Each layout names its source. The numbers are converted to the unit of the file by plain factors, not by the package.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import pytest

import gmwm
from gmwm.base.errors import GmwmWarning
from gmwm.base.units import find_unit

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


def table(header: str, row: str = "{t:.3f},{g},{a}", *, deg=False, g=False, head="", scale=(1.0, 1.0)):
    """Return the text of a table: a header and rows with the time, gyroscopes and accelerometers."""
    gyro = GYRO / (DEG if deg else 1.0) / scale[0]
    accel = ACCEL / (G if g else 1.0) / scale[1]
    separator = next(mark for mark in ",;\t " if mark in row)

    def write() -> str:
        rows = (
            row.format(
                k=k, t=k / RATE, ns=k * 10_000_000, us=k * 10_000, ms=k * 10, wall=1_700_000_000 + k / RATE,
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
LAYOUTS = [*NAMES]


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_a_layout_is_read_without_options(tmp_path, layout, recwarn):
    path = tmp_path / layout.file
    path.write_text(layout.text(), encoding="utf-8")
    imu = gmwm.read(path, **layout.options)
    assert imu.rate == pytest.approx(RATE, rel=1e-6)
    truth = {"gyro": GYRO, "accel": ACCEL}
    assert list(imu) == [f"{sensor}_{axis}" for sensor in layout.sensors for axis in "xyz"]
    for sensor in layout.sensors:
        values = np.column_stack([imu[f"{sensor}_{axis}"].values for axis in "xyz"])
        np.testing.assert_allclose(values, truth[sensor], rtol=1e-9, atol=1e-12)
    codes = [remark.code for remark in imu.remarks]
    assert [code for code in layout.remarks if code not in codes] == []
    assert not recwarn.list
    stream = gmwm.stream(path, **layout.options)
    assert np.concatenate([chunk.values["gyro_x"] for chunk in stream]).tolist() == imu["gyro_x"].values.tolist()


QUESTIONS = [
    ("a whole sensor is lost", "time_s,gyro_x_furlong,gyro_y_furlong,gyro_z_furlong,ax,ay,az", "columns-ambiguous",
     "accel_x:4,accel_y:5,accel_z:6,gyro_x:1,gyro_y:2,gyro_z:3,time:0"),
    ("mega-g is not milli-g", "time_s,gyro_x [dps],gyro_y [dps],gyro_z [dps],acc_x [Mg],acc_y [Mg],acc_z [Mg]",
     "unit-unknown", "units=accel:m/s²"),
    ("p and q without r", "time_s,p,q,wind", "no-inertial-data", "gyro_x:1"),
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


def test_one_axis_that_is_not_read_is_a_warning(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text(table("time_s,gyro_x [dps],gyro_y [dps],gyro_z_furlong,ax [g],ay [g],az [g]", deg=True, g=True)())
    with pytest.warns(GmwmWarning, match="gyro_z_furlong"):
        imu = gmwm.read(path)
    assert "gyro_x" in imu
    assert "gyro_z" not in imu
    gmwm.read(path, columns={"gyro_z": None})  # the user has decided: no warning


@pytest.mark.parametrize(
    ("texts", "name"),
    [
        ("deg/s|°/s|º/s|dps|DPS|deg_per_s|degps|degs|degrees per second|deg s^-1|deg·s⁻¹|Deg/Sec", "deg/s"),
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
