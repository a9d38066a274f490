"""More files of loggers, by public descriptions of programs, applications and devices; see test_layouts.py."""

from __future__ import annotations

import json
import struct
from datetime import datetime, timedelta

import numpy as np
import pandas
import pytest

import gmwm
from gmwm.base.errors import ReadError
from tests.helpers import only, raises
from tests.readers.test_layouts import (
    ACCEL,
    GYRO,
    RATE,
    SIZE,
    Layout,
    long,
    require_recording,
    sentences,
    table,
)

SI = {"units": {"gyro": "rad/s", "accel": "m/s2"}}
_AXES = "gyro_x [dps],gyro_y [dps],gyro_z [dps],acc_x [g],acc_y [g],acc_z [g]"


def clock(name: str, column: str, stamp, source: str, *, remark="time-read", **options) -> Layout:
    """Return a table whose time stamps `stamp` writes."""
    text = table(f"{column},{_AXES}", "{s},{g},{a}", deg=True, g=True, stamp=stamp)
    return Layout(name, source, text, remarks=(remark,), **options)


def since(begin: datetime, unit: timedelta, form: str):
    """Return a writer of the time since `begin`."""
    return lambda time: format((time - begin) / unit, form)


_DAY = timedelta(days=1)
CLOCKS = [
    clock("serial days of Excel", "Time", since(datetime(1899, 12, 30), _DAY, ".10f"), "Excel, date systems"),
    clock("datenum", "datenum", lambda time: f"{(time - datetime(1, 1, 1)) / _DAY + 367:.10f}",
          "MATLAB documentation, datenum"),
    clock("ticks of .NET", "Ticks", lambda time: f"{(time - datetime(1, 1, 1)) // timedelta(microseconds=1)}0",
          "documentation of .NET, DateTime.Ticks"),
    clock("datetime of MATLAB", "Timestamp", lambda time: f"{time:%d-%b-%Y %H:%M:%S.%f}"[:-3],
          "MATLAB documentation, writetimetable"),
    clock("day first with points", "Zeit", lambda time: f"{time:%d.%m.%Y %H:%M:%S.%f}"[:-3], "DIN 1355"),
    clock("month first", "Timestamp", lambda time: f"{time:%m/%d/%Y %H:%M:%S.%f}"[:-3], "SensorConnect CSV"),
    clock("clock of 12 hours", "Timestamp", lambda time: f"{time:%m/%d/%Y %I:%M:%S.%f}"[:-3] + f"{time: %p}",
          "Excel, time formats of the United States"),
    clock("year first with a clock of 12 hours", "t", lambda time: f"{time:%Y-%m-%d %I:%M:%S.%f}"[:-3] + f"{time: %p}",
          "strftime of C, %p"),
    clock("colon before milliseconds", "Time", lambda time: f"{time:%H:%M:%S:%f}"[:-3], "LabVIEW format strings"),
    clock("dashes between all parts", "Time", lambda time: f"{time:%Y-%m-%d_%H-%M-%S-%f}"[:-3], "names of log files"),
    clock("digits of a time of day", "UTC (hhmmss.ss)", lambda time: f"{time:%H%M%S.%f}"[:-4], "NMEA 0183, UTC"),
    clock("asctime", "Time", lambda time: f"{time:%a %b %d %H:%M:%S.%f %Y}", "asctime of C"),
]  # fmt: skip


def lvm(columns: str, decimal: str = ".") -> str:
    """Return a measurement file of LabVIEW with an X column ("One") or without ("No")."""
    tag = {name: "\t".join([value] * 6) for name, value in (("X0", "0.0"), ("dx", "0.01"))}
    head = (
        f"LabVIEW Measurement\t\nWriter_Version\t2\nReader_Version\t2\nSeparator\tTab\nDecimal_Separator\t{decimal}\n"
        f"Multi_Headings\tNo\nX_Columns\t{columns}\nTime_Pref\tAbsolute\nDate\t2024/05/13\nTime\t11:59:59.7\n"
        "***End_of_Header***\t\n\nChannels\t6\t\t\t\t\t\nSamples\t64\t64\t64\t64\t64\t64\n"
        f"Y_Unit_Label\tdeg/s\tdeg/s\tdeg/s\tg\tg\tg\nX0\t{tag['X0']}\nDelta_X\t{tag['dx']}\n"
        "***End_of_Header***\t\t\t\t\t\t\n"
    )
    rows = table(
        "X_Value\tgyro_x\tgyro_y\tgyro_z\taccel_x\taccel_y\taccel_z\tComment",
        "{t:.6f}\t{g}\t{a}" if columns == "One" else "\t{g}\t{a}", deg=True, g=True,
    )()  # fmt: skip
    header, _, body = rows.partition("\n")
    return head.replace("0.0", f"0{decimal}0").replace("\t0.1", "\t0,1") + header + "\n" + body.replace(".", decimal)


PROGRAMS = [
    Layout("LabVIEW with an X column", "National Instruments, specification of .lvm", lambda: lvm("One"), "log.lvm"),
    Layout("LabVIEW without an X column", "the same", lambda: lvm("No"), "log.lvm", remarks=("rate-stated",)),
    Layout("LabVIEW with a decimal comma", "the same", lambda: lvm("One", ","), "log.lvm"),
    Layout("Consensys of Shimmer", "Shimmer Consensys user guide, CSV export", lambda: table(
        "\t".join(["ms", *["deg/s"] * 3, *["m/(s^2)"] * 3, ""]), "17000000{ms:05d}\t{g}\t{a}\t", deg=True,
        head='"sep=\t"\n' + "\t".join(f"Shimmer_9A2B_{name}_CAL" for name in (
            "Timestamp_Unix", "Gyro_X", "Gyro_Y", "Gyro_Z", "Accel_LN_X", "Accel_LN_Y", "Accel_LN_Z")) + "\t\n")(),
        remarks=("left-out",)),
    Layout("sbgBasicLogger", "SBG Systems, sbgECom: loggerEntryImu.cpp", table(
        "(us)\t(na)\t(m.s^-2)\t(m.s^-2)\t(m.s^-2)\t(deg.s^-1)\t(deg.s^-1)\t(deg.s^-1)\t(degC)",
        "{us}\t0x00FF\t{a}\t{g}\t25.1", deg=True,
        head="timestamp\tstatus\taccelX\taccelY\taccelZ\tgyroX\tgyroY\tgyroZ\ttemperature\n"), "imuShort.txt"),
    Layout("WitMotion", "WitMotion's program, recorded data", table(
        "time\tDeviceName\tChipTime()\tAccX(g)\tAccY(g)\tAccZ(g)\tAsX(°/s)\tAsY(°/s)\tAsZ(°/s)\tAngleX(°)\tT(°)",
        "{s}\tHC-06(00:0C:BF)\tnull\t{a}\t{g}\t0.1\t25.1", deg=True, g=True,
        stamp=lambda time: f"{time:%Y-%m-%dT%H:%M:%S.%f}"[:-3]), "wit.txt", remarks=("left-out", "time-read")),
    Layout("MetaBase", "MbientLab tutorials, CSV of MetaBase", table(
        "epoch (ms),time (01:00),elapsed (s),x-axis (deg/s),y-axis (deg/s),z-axis (deg/s)",
        "17000000{ms:05d},{s},{t:.3f},{g}", deg=True, stamp=lambda time: f"{time:%Y-%m-%dT%H.%M.%S.%f}"[:-3]),
        sensors=("gyro",)),
    Layout("Physics Toolbox", "Physics Toolbox Sensor Suite, CSV of several sensors",
           table("time,gFx,gFy,gFz,wx,wy,wz", "{t:.3f},{a},{g}", g=True), remarks=("file-content",)),
    Layout("AndroSensor in Latin-1", "AndroSensor, CSV export", table(
        "ACCELEROMETER X (m/s²);ACCELEROMETER Y (m/s²);ACCELEROMETER Z (m/s²);GRAVITY X (m/s²);GRAVITY Y (m/s²);"
        "GRAVITY Z (m/s²);GYROSCOPE X (rad/s);GYROSCOPE Y (rad/s);GYROSCOPE Z (rad/s);Time since start in ms ;"
        "YYYY-MO-DD HH-MI-SS_SSS", "{a};0;0;9.8;{g};{ms};{s}", head="sep=;\n",
        stamp=lambda time: f"{time:%Y-%m-%d %H:%M:%S:%f}"[:-3]), remarks=("left-out",), encoding="latin-1"),
    Layout("OpenLog Artemis", "SparkFun, OpenLog Artemis: columns of the ICM-20948", table(
        "rtcDate,rtcTime,aX,aY,aZ,gX,gY,gZ,mX,mY,mZ,imu_degC,output_Hz,", "{s},{a},{g},1,2,3,25.{k},100.0,", deg=True,
        g=True, scale=(1.0, 1e-3), stamp=lambda time: f"{time:%m/%d/%Y,%H:%M:%S.%f}"[:-4]), "dataLog00001.TXT",
        remarks=("file-content", "time-read")),
    Layout("gcsv of Gyroflow", "Gyroflow documentation, gcsv reference", table(
        "t,gx,gy,gz,ax,ay,az", "{ms},{g},{a}", g=True, scale=(0.5, 0.25), head="GYROFLOW IMU LOG\nversion,1.3\n"
        "id,custom\norientation,YxZ\ntimestamp,1644159993\ntscale,0.001\ngscale,0.5\nascale,0.25\n"), "video.gcsv",
        remarks=("file-content",)),
    Layout("writetimetable of MATLAB", "MATLAB documentation, writetimetable: durations", table(
        "Time,gyro_1,gyro_2,gyro_3,acc_1,acc_2,acc_3", "{t:.2f} sec,{g},{a}"), options=SI),
    Layout("Control Center of VectorNav", "VectorNav, names of the binary groups", table(
        "TimeStartup,Yaw,Pitch,Roll,AccelX,AccelY,AccelZ,AngularRateX,AngularRateY,AngularRateZ", "{ns},1,2,3,{a},{g}"),
        options=SI, remarks=("time-read",)),
    Layout("registers of ADIS", "Analog Devices, data sheet ADIS16470: output registers", table(
        "DATA_CNTR,X_GYRO_OUT (deg/s),Y_GYRO_OUT (deg/s),Z_GYRO_OUT (deg/s),X_ACCL_OUT (mg),Y_ACCL_OUT (mg),"
        "Z_ACCL_OUT (mg),TEMP_OUT", "{k},{g},{a},25.0", deg=True, g=True, scale=(1.0, 1e-3)), options={"rate": RATE}),
    Layout("Aceinna", "Aceinna OpenIMU developers manual, CSV of the navigation view", table(
        "timeCounter (msec),xAccel (m/s/s),yAccel (m/s/s),zAccel (m/s/s),xRate (deg/s),yRate (deg/s),zRate (deg/s)",
        "{ms},{a},{g}", deg=True), remarks=("left-out",)),
    Layout("cltool of Inertial Sense", "Inertial Sense documentation, DID_IMU", table(
        "time,status,I.pqr[0],I.pqr[1],I.pqr[2],I.acc[0],I.acc[1],I.acc[2]", "{t:.3f},0,{g},{a}"), options=SI),
    Layout("columns of another language", "WitMotion's program in Chinese", table(
        "时间;角速度X(°/s);角速度Y(°/s);角速度Z(°/s);加速度X(g);加速度Y(g);加速度Z(g)", "{ms};{g};{a}", deg=True,
        g=True), encoding="gb18030"),
    Layout("VectorNav's exporter", "VectorNav SDK, getMeasurementName", table(
        "timeStartup,uncompAccelX,uncompAccelY,uncompAccelZ,uncompGyroX,uncompGyroY,uncompGyroZ,temperature",
        "{k}0000000,{a},{g},25.0"), remarks=("file-content",)),
    Layout("Unicode text of Excel", "Excel, Unicode Text (*.txt): UTF-16 with tabs", table(
        "time [s]\t" + _AXES.replace(",", "\t"), "{t:.3f}\t{g}\t{a}", deg=True, g=True), "log.txt", encoding="utf-16"),
    Layout("redirected output of PowerShell", "PowerShell documentation, about_Character_Encoding", lambda: table(
        f"time [s],{_AXES}", deg=True, g=True)().replace("\n", "\r\n"), encoding="utf-16-le"),
    Layout("UTF-16 of Java", "Java documentation, Charset: UTF-16BE", table(
        f"time [s],{_AXES}", deg=True, g=True), encoding="utf-16-be"),
    Layout("carriage returns", "Excel, CSV (Macintosh)", lambda: table(
        f"time [s],{_AXES}", deg=True, g=True)().replace("\n", "\r")),
    Layout("labels before three numbers", "printf of many drivers", table(
        "IMU ready", "[{us:08d}] gyro: {G[0]} {G[1]} {G[2]}, acc: {A[0]} {A[1]} {A[2]}"), "log.txt",
        options={"units": {"gyro": "rad/s", "accel": "m/s2", "time": "us"}}),
    Layout("labels with units", "serial monitors of sensor libraries", table(
        "Booting ...", "ax = {A[0]} m/s^2, ay = {A[1]} m/s^2, az = {A[2]} m/s^2, gx = {G[0]} rad/s, gy = {G[1]} rad/s, "
        "gz = {G[2]} rad/s"), "log.txt", options={"rate": RATE}),
    Layout("lines of Adafruit's examples", "Adafruit MPU6050 library, basic_readings", table(
        "Adafruit MPU6050 test!\nMPU6050 Found!\nAccelerometer range set to: +-8G\nFilter bandwidth set to: 5 Hz\n",
        "Acceleration X: {A[0]}, Y: {A[1]}, Z: {A[2]} m/s^2\nRotation X: {G[0]}, Y: {G[1]}, Z: {G[2]} rad/s\n"
        "Temperature: 26.{k:02d} degC\n"), "serial.log", options={"rate": RATE}),
    Layout("a title above the axes", "Adafruit BNO08x library for CircuitPython, simpletest", table(
        "", "Acceleration:\nX: {A[0]}  Y: {A[1]} Z: {A[2]}  m/s^2\nGyro:\nX: {G[0]} Y: {G[1]} Z: {G[2]} rads/s"),
        "serial.txt", options={"rate": RATE}),
    Layout("log lines with colours", "ESP-IDF, ESP_LOGI on a serial port", table(
        "\x1b[0;32mI (250) imu: ready\x1b[0m", "\x1b[0;32mI ({ms}) MPU: Accel: X={A[0]}, Y={A[1]}, Z={A[2]}\x1b[0m\n"
        "\x1b[0;32mI ({ms}) MPU: Gyro: X={G[0]}°/s, Y={G[1]}°/s, Z={G[2]}°/s\x1b[0m", deg=True), "log.txt",
        options={"units": {"accel": "m/s2", "time": "ms"}}),
    Layout("one axis in each line", "serial output of FDILink modules", table(
        "", "Gyroscope_X(rad/s): {G[0]}\nGyroscope_Y(rad/s): {G[1]}\nGyroscope_Z(rad/s): {G[2]}\n"
        "Accelerometer_X(m/s^2): {A[0]}\nAccelerometer_Y(m/s^2): {A[1]}\nAccelerometer_Z(m/s^2): {A[2]}\n"
        "Timestamp(us): {us}"), "log.txt"),
    Layout("equal lines below titles", "Arduino MKR IoT Carrier, sketches of its IMU", table(
        "", "IMU module\nGyroscope:\n\t X:{G[0]}\n\t Y:{G[1]}\n\t Z:{G[2]}\nAccelerometer:\n\t X:{A[0]}\n\t Y:{A[1]}\n"
        "\t Z:{A[2]}"), "log.txt", options={"rate": RATE, **SI}),
    Layout("values in parentheses", "M5Stack, AHRS examples", table(
        "boot", "M5StackAHRS:\n gyro=({G[0]},{G[1]},{G[2]})\n accl=({A[0]},{A[1]},{A[2]})\n ahrs=(1,2,{k})"), "log.txt",
        options={"rate": RATE, **SI}),
    Layout("units before brackets", "SparkFun ICM-20948 library, Example1_Basics", table(
        "", "Scaled. Acc (m/s2) [ {A[0]}, {A[1]}, {A[2]} ], Gyr (DPS) [ {G[0]}, {G[1]}, {G[2]} ], "
        "Mag (uT) [ 1, 2, {k} ], Tmp (C) [ 00025.78 ]", deg=True), "log.txt", options={"rate": RATE}),
    Layout("logging of Python", "Python documentation, logging: asctime and levelname", table(
        "INFO:root:ready", "{s} INFO gx={G[0]} gy={G[1]} gz={G[2]} ax={A[0]} ay={A[1]} az={A[2]}",
        stamp=lambda time: f"{time:%Y-%m-%d %H:%M:%S,%f}"[:-3]), "log.log", options=SI),
    Layout("rate in a title", "ST, titles of exported registers", table(
        _AXES, "{g},{a}", deg=True, g=True, head="LSM6DSO ODR = 100 Hz FS = 250 dps\n"), remarks=("rate-stated",)),
    Layout("RawSensors of Advanced Navigation", "Advanced Navigation, Logging utility", table(
        "Unix Time,Microseconds,Accelerometer X (m/s/s),Accelerometer Y (m/s/s),Accelerometer Z (m/s/s),"
        "Gyroscope X (rad/s),Gyroscope Y (rad/s),Gyroscope Z (rad/s),Magnetometer X (mG),Magnetometer Y (mG)",
        "1700000000,{us},{a},{g},1,2"), remarks=("time-read",)),
    Layout("AirSim", "AirSim, sensors of a recording", table(
        "TimeStamp\tAngularVelX\tAngularVelY\tAngularVelZ\tLinearAccX\tLinearAccY\tLinearAccZ", "{ns}\t{g}\t{a}"),
        options=SI),
    Layout("units in cells", "exports of databases of time series", table(
        "time,gyro_x,gyro_y,gyro_z,acc_x,acc_y,acc_z",
        "{ms} ms,{G[0]} dps,{G[1]} dps,{G[2]} dps,{A[0]} g,{A[1]} g,{A[2]} g", deg=True, g=True)),
]  # fmt: skip


def objects(record) -> str:
    """Return JSON lines."""
    return "".join(json.dumps(record(k)) + "\n" for k in range(SIZE))


def vector(values: np.ndarray) -> dict[str, float]:
    """Return the axes of one sample of a sensor by their letters."""
    return dict(zip("xyz", values.tolist(), strict=True))


def columns() -> dict[str, list[float]]:
    """Return the time and the six axes, by their names."""
    names = ("t", *(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz"))
    rows = np.column_stack([np.arange(SIZE) / 100, GYRO, ACCEL])
    return dict(zip(names, rows.T.tolist(), strict=True))


def echo(seconds: str, fraction: str) -> str:
    """Return messages as rostopic prints them."""
    return "".join(
        f"header:\n  seq: {k}\n  stamp:\n    {seconds}: 1700000000\n    {fraction}: {k * 10_000_000}\n  frame_id: imu\n"
        "orientation_covariance:\n- 0.0\n- 0.0\n"
        + "".join(
            f"{name}:\n" + "".join(f"  {axis}: {value!r}\n" for axis, value in vector(values[k]).items())
            for name, values in (("angular_velocity", GYRO), ("linear_acceleration", ACCEL))
        )
        + "---\n"
        for k in range(SIZE)
    )


RECORDS = [
    Layout("JSON lines of HiPNUC", "HiPNUC products: hipnuc_json.h", lambda: objects(lambda k: {
        "type": "HI91", "device_time_ms": 10 * k, "acceleration_m_s2": ACCEL[k].tolist(), "euler_rad": [0.1, 0.2, None],
        "angular_velocity_rad_s": GYRO[k].tolist(), "temperature_c": 25.0 + k}), "hi91.jsonl"),
    Layout("flat JSON lines", "SensePi JSON streaming protocol", lambda: objects(lambda k: {
        "timestamp_ns": 1712500000000000000 + 10_000_000 * k, "t_s": k / 100, "sensor_id": "mpu6050_1",
        **{f"a{axis}": value for axis, value in vector(ACCEL[k]).items()},
        **{f"g{axis}": value for axis, value in vector(GYRO[k]).items()}}), "log.jsonl", options=SI),
    Layout("objects in objects", "JSON of nodes of MQTT", lambda: objects(lambda k: {
        "ts": k / 100, "accel": vector(ACCEL[k]), "gyro": vector(GYRO[k])}), "log.json", options=SI),
    Layout("a list of objects", "to_json of pandas, orient='records'", lambda: "[" + ",\n".join(
        objects(lambda k: {"t": k / 100, "gyro": GYRO[k].tolist(), "acc": ACCEL[k].tolist()}).splitlines()) + "]",
        "log.json", options=SI),
    *(Layout(f"a document of pandas, {form}", f"to_json of pandas, orient={form!r}",
             lambda form=form: pandas.DataFrame(columns()).to_json(orient=form), "log.json", options=SI)
      for form in ("split", "columns", "index", "table")),
    Layout("columns of lists", "JSON of JavaScript", lambda: json.dumps(columns(), indent=1), "log.json", options=SI),
    *(Layout(f"rostopic echo with {fraction}", "ROS wiki, rostopic; ROS 2 tutorials, ros2 topic echo",
             lambda pair=(seconds, fraction): echo(*pair), "echo.txt")
      for seconds, fraction in (("secs", "nsecs"), ("sec", "nanosec"))),
]  # fmt: skip
LAYOUTS = [*CLOCKS, *PROGRAMS, *RECORDS]


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.name)
def test_a_file_of_a_logger_is_read(tmp_path, layout):
    require_recording(tmp_path / layout.file, layout)


def test_lines_of_other_lengths_are_left_out_by_their_first_word(tmp_path):
    rows = [f"$IMU,{k / 100},{','.join(map(repr, [*GYRO[k].tolist(), *ACCEL[k].tolist()]))}\n" for k in range(SIZE)]
    (path := tmp_path / "log.txt").write_text(
        "".join(row + "$GPS,47.1,8.5\n" * (k % 4 == 1) for k, row in enumerate(rows))
    )
    names = [None, "time", *(f"{sensor}_{axis}" for sensor in ("gyro", "accel") for axis in "xyz")]
    imu = gmwm.read(path, columns=names, **SI)
    assert imu.segments == ((0, SIZE),)
    assert np.array_equal(imu["accel_z"].values, ACCEL[:, 2])
    assert ("$GPS",) in [remark.facts.get("names") for remark in imu.remarks]
    stream = gmwm.stream(path, columns=names, **SI)
    assert stream.time_base.gaps == ()


def test_noon_and_midnight_on_a_clock_of_12_hours(tmp_path):
    for begin in (datetime(2024, 5, 1, 11, 59, 59), datetime(2024, 5, 1, 23, 59, 59)):
        times = [begin + timedelta(milliseconds=50 * k) for k in range(60)]
        (path := tmp_path / "log.csv").write_text(
            "Time,gx [dps]\n" + "".join(f"{time:%I:%M:%S.%f %p},{k % 3}\n" for k, time in enumerate(times))
        )
        imu = gmwm.read(path)
        assert (imu.rate, imu.segments) == (pytest.approx(20), ((0, 60),))
        assert imu["gyro_x"].start == pytest.approx(begin.hour * 3600 + 59 * 60 + 59)


@pytest.mark.slow
def test_a_broken_line_among_json_objects_states_its_line(tmp_path):
    lines = RECORDS[1].text().splitlines()
    lines[20] = lines[20][:30]
    (path := tmp_path / "log.jsonl").write_text("\n".join(lines) + "\n")
    with raises(ReadError, "line 21", code="row-length", advises=["bad_lines='skip'"]):
        gmwm.read(path, **SI)
    with pytest.warns(gmwm.errors.GmwmWarning, match="1 lost sample"):
        assert len(gmwm.read(path, **SI, bad_lines="skip")) == SIZE - 1


def test_json_objects_of_several_sensors_are_topics(tmp_path):
    words = {"gyro": "Gyroscope", "accel": "Accelerometer", "mag": "Magnetometer"}
    rows = long(words, "", "{label} {ms} {x!r} {y!r} {z!r}").split("\n")[:-1]
    names = ("sensor", "time", "x", "y", "z")
    entries = [dict(zip(names, [row.split()[0], *map(float, row.split()[1:])], strict=True)) for row in rows]
    (path := tmp_path / "log.json").write_text(json.dumps(entries))
    imu = gmwm.read(path, topic="Gyroscope", units={"gyro": "rad/s"})
    assert np.array_equal(np.column_stack([imu[axis].values for axis in imu]), GYRO)


def text_of(text: str) -> bytes:
    """Return a string of MCAP: its length and its bytes."""
    return struct.pack("<I", len(text)) + text.encode()


def mcap(record, encoding="json") -> bytes:
    """Return an MCAP file with one topic, by the specification of the format (mcap.dev/spec)."""
    parts = [(1, text_of("") + text_of("test")),
             (3, struct.pack("<H", 1) + text_of("Imu") + text_of("jsonschema") + text_of("{}")),
             (4, struct.pack("<HH", 1, 1) + text_of("/imu") + text_of(encoding) + struct.pack("<I", 0))]  # fmt: skip
    for k in range(SIZE):
        time = 1_700_000_000_000_000_000 + k * 10_000_000
        parts.append((5, struct.pack("<HIQQ", 1, k, time, time) + json.dumps(record(k)).encode()))
    parts += [(15, struct.pack("<I", 0)), (2, struct.pack("<QQI", 0, 0, 0))]
    return b"\x89MCAP0\r\n" + b"".join(struct.pack("<BQ", k, len(c)) + c for k, c in parts) + b"\x89MCAP0\r\n"


@pytest.mark.parametrize("stamp", ["header", "timestamp", ""])
def test_json_messages_in_mcap(tmp_path, stamp):
    def record(k: int) -> dict[str, object]:
        time = {"sec": 1_700_000_000, "nsec": k * 10_000_000}
        stamps = {"header": {"header": {"stamp": time, "frame_id": "imu"}}, "timestamp": {"timestamp": time}}
        return stamps.get(stamp, {}) | {"angular_velocity": vector(GYRO[k]), "linear_acceleration": vector(ACCEL[k])}

    (path := tmp_path / "log.mcap").write_bytes(mcap(record))
    imu = gmwm.read(path)
    assert imu.rate == pytest.approx(RATE)
    assert imu["gyro_x"].start == pytest.approx(1.7e9)
    assert np.array_equal(np.column_stack([imu[axis].values for axis in imu]), np.hstack([GYRO, ACCEL]))
    assert any(remark.code == "time-read" for remark in imu.remarks) == (not stamp)


def test_messages_of_another_encoding_are_named(tmp_path):
    (path := tmp_path / "log.mcap").write_bytes(mcap(lambda k: {}, "protobuf"))
    with raises(ReadError, "protobuf", code="no-inertial-data"):
        gmwm.read(path)


def test_corrected_data_of_novatel_are_named(tmp_path):
    body = sentences(lambda k, g, a: f"CORRIMUDATASA,1105,42;1105,{42 + k / RATE},{g},{a}", sign="%", crc=True)()
    (path := tmp_path / "log.asc").write_text(body)
    with raises(ReadError, "CORRIMUDATASA", code="no-inertial-data", advises=["RAWIMUSXA"]):
        gmwm.read(path)


def test_a_time_without_a_usual_name_is_stated(tmp_path):
    (path := tmp_path / "log.csv").write_text(table(f"loggingTime (s),{_AXES}", deg=True, g=True)())
    assert "loggingTime (s)" in only(gmwm.read(path).remarks, "left-out:short").facts["names"]


def test_a_date_and_a_time_under_one_name_in_a_table_with_blanks(tmp_path):
    text = table("time gx[dps] gy[dps] gz[dps]", "{s} {g}", deg=True, stamp=lambda time: f"{time:%d/%m/%Y %H:%M:%S.%f}")
    (path := tmp_path / "log.txt").write_text(text())
    imu = gmwm.read(path)
    assert (imu.rate, len(imu)) == (pytest.approx(RATE), SIZE)


def test_the_only_bag_of_a_folder_is_read(tmp_path):
    """M2DGR has a bag beside the trajectory of the ground truth."""
    data = mcap(lambda k: {"angular_velocity": vector(GYRO[k])})
    (tmp_path / "room_01.mcap").write_bytes(data)
    (tmp_path / "room_01.txt").write_text("1628058816.9 0 0 0 0 0 0 1\n" * 9)
    assert gmwm.read(tmp_path).axes == ("gyro_x", "gyro_y", "gyro_z")
    (tmp_path / "room_02.mcap").write_bytes(data)
    with raises(ReadError, "room_01.mcap, room_02.mcap", code="is-directory"):
        gmwm.read(tmp_path)


@pytest.mark.parametrize(
    ("text", "code"),
    [(b"{\"a\":" * 5000 + b"1" + b"}" * 5000, "cut-off"), (b"[{\"a\":1}", "cut-off"),
     (b"{\"t\": 1, \"gx\": {}}\n" * 20, "no-time")],
    ids=["nested", "cut", "no numbers"],
)  # fmt: skip
def test_json_that_is_no_table_is_an_error(tmp_path, text, code):
    (path := tmp_path / "log.json").write_bytes(text)
    with raises(ReadError, code=code) if code != "no-time" else pytest.raises(ReadError):
        gmwm.read(path)


def test_a_result_of_gmwm_is_no_recording(tmp_path):
    path = tmp_path / "calibration.json"
    path.write_text('{\n "format": "gmwm-calibration",\n "version": 2\n}\n', encoding="utf-8")
    with raises(ReadError, "a result of gmwm", advises=["recording"]):
        gmwm.read(path)


def test_the_nan_of_python_in_json_is_a_missing_value(tmp_path):
    samples = [{"time": 0.01 * k, "gx": GYRO[k, 0], "gy": GYRO[k, 1], "gz": GYRO[k, 2]} for k in range(SIZE)]
    samples[20] |= {"gx": float("nan"), "gy": float("inf"), "gz": None}
    path = tmp_path / "log.jsonl"
    for text in ("\n".join(map(json.dumps, samples)), json.dumps(samples)):
        path.write_text(text)
        imu = gmwm.read(path, units={"gyro": "rad/s"})
        assert imu["gyro_x"].values.size == SIZE - 1
        assert [row for row, _ in imu.time_base.gaps] == [20]
