"""Tables as programs and devices export them: names, units and clocks are found without any option.

The headers are those of the programs' sources and documents; the numbers are made up.
"""

import gzip
import zipfile

import numpy as np
import pytest

from gmwm.base.errors import ReadError, UnitError
from gmwm.files.readers import read, stream
from tests.helpers import raises

ROWS = 300
K = np.arange(ROWS)
RNG = np.random.default_rng(1)
GYRO = RNG.normal(0, 0.01, (ROWS, 3)).round(6)
ACCEL = (RNG.normal(0, 0.02, (ROWS, 3)) + np.array([0, 0, 9.8])).round(5)
DEG, G = np.degrees(GYRO).round(7), (ACCEL / 9.80665).round(8)
US, NS, ZERO, TEMPERATURE = K * 10_000 + 5_000_000, K * 10_000_000 + 1_621_218_775_548_635_005, K * 0, K * 0 + 30.5
SECONDS = K / 100


def table(header, *columns, sep=","):
    cells = [
        column
        for group in columns
        for column in (group.T if isinstance(group, np.ndarray) and group.ndim == 2 else [group])
    ]
    return header + "\n" + "".join(sep.join(map(str, row)) + "\n" for row in zip(*cells, strict=True))


COVARIANCE = ",".join(f"field.angular_velocity_covariance{k}" for k in range(9))
CASES = {
    "log_0_sensor_combined_0.csv": table(
        "timestamp,gyro_rad[0],gyro_rad[1],gyro_rad[2],gyro_integral_dt,accelerometer_timestamp_relative,"
        "accelerometer_m_s2[0],accelerometer_m_s2[1],accelerometer_m_s2[2],accelerometer_integral_dt,clipping",
        US, GYRO, ZERO, ZERO, ACCEL, ZERO, ZERO,
    ),
    "log_0_sensor_gyro_0.csv": table(
        "timestamp,timestamp_sample,device_id,x,y,z,temperature,error_count,clip_counter[0],clip_counter[1],samples",
        US + K % 7, US, ZERO + 1310988, GYRO, TEMPERATURE, ZERO, ZERO, ZERO, ZERO,
    ),
    "log_0_sensor_accel_1.csv": table("timestamp,device_id,x,y,z,temperature", US, ZERO, ACCEL, TEMPERATURE),
    "mavlogdump.csv": table(
        "timestamp,TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        (1.6e9 + SECONDS).round(2), US, ZERO, GYRO, ACCEL, ZERO, ZERO, TEMPERATURE, ZERO, ZERO, ZERO, ZERO,
    ),
    "LOG00007.01.csv": table(
        "loopIteration, time (us), axisP[0], rssi, gyroADC[0] (deg/s), gyroADC[1] (deg/s), gyroADC[2] (deg/s), "
        "accSmooth[0] (g), accSmooth[1] (g), accSmooth[2] (g), debug[0], motor[0], flightModeFlags (flags)",
        K, US, ZERO, ZERO, DEG, G, ZERO, ZERO, ["ANGLE|ARM"] * ROWS, sep=", ",
    ),
    "unfiltered.01.csv": table(
        "loopIteration, time (us), gyroADC[0] (rad/s), gyroADC[1] (rad/s), gyroADC[2] (rad/s), gyroUnfilt[0] (rad/s), "
        "gyroUnfilt[1] (rad/s), gyroUnfilt[2] (rad/s)",
        K, US, GYRO / 2, GYRO, sep=", ",
    ),
    "instinct.csv": table(
        "GpsCycle,GpsWeek,GpsToW,TimeStartup,UnCompAccX,UnCompAccY,UnCompAccZ,UnCompGyroX,UnCompGyroY,UnCompGyroZ,"
        "Temperature,AccX,AccY,AccZ,GyroX,GyroY,GyroZ",
        ZERO, ZERO, ["nan"] * ROWS, NS - NS[0] + 8, ACCEL + 1, GYRO + 1, TEMPERATURE, ACCEL, GYRO,
    ),
    "kvh.csv": table(
        "TimeStartup,UnCompMagX,UnCompAccX,UnCompAccY,UnCompAccZ,UnCompGyroX,UnCompGyroY,UnCompGyroZ,Temperature",
        NS - NS[0], ZERO, ACCEL, GYRO, TEMPERATURE,
    ),
    "mip.csv": table(
        "DATA_START\nGPS TFlags,GPS Week,GPS TOW,X Accel [x8004],Y Accel [x8004],Z Accel [x8004],X Gyro [x8005],"
        "Y Gyro [x8005],Z Gyro [x8005],",
        ZERO, ZERO, SECONDS + 1000, G, GYRO,
    ),
    "sensorconnect.csv": table(
        "DATA_START\nTime," + ",".join(f"6251.00000-Inertial:scaled{s}{a}" for s in ("Accel", "Gyro") for a in "XYZ"),
        [f"2026-11-22 10:00:{second:09.6f}" for second in SECONDS], G, GYRO,
    ),
    "rostopic.csv": table(
        "%time,field.header.seq,field.header.stamp,field.header.frame_id,field.orientation.x,field.angular_velocity.x,"
        f"field.angular_velocity.y,field.angular_velocity.z,{COVARIANCE},field.linear_acceleration.x,"
        "field.linear_acceleration.y,field.linear_acceleration.z",
        NS + 3000 * (K % 5), K, NS, ["imu"] * ROWS, ZERO, GYRO, *[ZERO] * 9, ACCEL,
    ),
    "bagpy.csv": table(
        "Time,header.seq,header.stamp.secs,header.stamp.nsecs,header.frame_id,angular_velocity.x,angular_velocity.y,"
        "angular_velocity.z,linear_acceleration.x,linear_acceleration.y,linear_acceleration.z",
        [f"{n / 1e9 + 0.001 * (n % 3):.4f}" for n in NS], K, NS // 10**9, NS % 10**9, ["imu"] * ROWS, GYRO, ACCEL,
    ),
    "ros2.csv": table(
        "header.stamp.sec,header.stamp.nanosec,angular_velocity.x,angular_velocity.y,angular_velocity.z,"
        "linear_acceleration.x,linear_acceleration.y,linear_acceleration.z",
        NS // 10**9, NS % 10**9, GYRO, ACCEL,
    ),
    "plotjuggler.csv": table(
        "__time,/imu/angular_velocity/x,/imu/angular_velocity/y,/imu/angular_velocity/z,/imu/linear_acceleration/x,"
        "/imu/linear_acceleration/y,/imu/linear_acceleration/z",
        [f"{1621218775 + second:.9f}" for second in SECONDS], GYRO, ACCEL,
    ),
    "Gyroscope.csv": table('"Time (s)","X (rad/s)","Y (rad/s)","Z (rad/s)"', SECONDS, GYRO),
    "dot.csv": table(
        "sep=,\nDeviceTag:,D1\nOutputRate:,100Hz\nMeasurementMode:,Rate quantities\n\n"
        "PacketCounter,SampleTimeFine,Acc_X,Acc_Y,Acc_Z,Gyr_X,Gyr_Y,Gyr_Z",
        K, US, ACCEL, DEG,
    ),
    "sensorlog.csv": table(
        "loggingTime(txt),loggingSample(N),accelerometerTimestamp_sinceReboot(s),accelerometerAccelerationX(G),"
        "accelerometerAccelerationY(G),accelerometerAccelerationZ(G),gyroRotationX(rad/s),gyroRotationY(rad/s),"
        "gyroRotationZ(rad/s),motionUserAccelerationX(G),motionRotationRateX(rad/s),motionRotationRateY(rad/s)",
        ["2026-11-22T10:00:00.000+01:00"] * ROWS, K, SECONDS + 100, G, GYRO, ZERO, GYRO[:, :2] + 1,
    ),
    "two lines.csv": table(
        ",Gyroscope,,,Accelerometer,,\nTime (s),X (deg/s),Y (deg/s),Z (deg/s),X (g),Y (g),Z (g)", SECONDS, DEG, G
    ),
    "three lines.csv": table(
        "time,gyro,gyro,gyro,accel,accel,accel\n,x,y,z,x,y,z\ns,rad/s,rad/s,rad/s,g,g,g", SECONDS, GYRO, G
    ),
    "serial plotter.txt": table("# rad/s, m/s^2 units", *[
        [f"{name}:{value}" for value in column]
        for name, column in zip(("t_ms", "gx", "gy", "gz", "ax", "ay", "az"), (K * 10, *GYRO.T, *ACCEL.T), strict=True)
    ], sep=" "),
    "serial monitor.txt": table("# gyro in rad/s", [
        f"10:00:{second:06.3f} -> gx={x}, gy={y}, gz={z}"
        for second, (x, y, z) in zip(SECONDS, GYRO.tolist(), strict=True)
    ]),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_an_export_is_read_without_options(tmp_path, name):
    path = tmp_path / name
    path.write_text(CASES[name])
    imu = read(path)
    assert imu.rate == pytest.approx(100, rel=1e-9)
    assert len(imu.segments) == 1
    for sensor, numbers in (("gyro", GYRO), ("accel", ACCEL)):
        for k, axis in enumerate("xyz"):
            if f"{sensor}_{axis}" in imu.axes:
                np.testing.assert_allclose(imu[f"{sensor}_{axis}"].values, numbers[:, k], rtol=1e-5, atol=1e-6)
    wanted = [sensor for sensor in ("gyro", "accel") if WITHOUT.get(name) != sensor]
    assert imu.axes == tuple(f"{sensor}_{axis}" for sensor in wanted for axis in "xyz")
    if "emperature" in CASES[name] or ",T," in CASES[name]:
        assert imu.temperature == pytest.approx(30.5)
    assert sum(map(len, stream(path))) == ROWS


WITHOUT = {
    "log_0_sensor_gyro_0.csv": "accel",
    "log_0_sensor_accel_1.csv": "gyro",
    "unfiltered.01.csv": "accel",
    "Gyroscope.csv": "accel",
    "serial monitor.txt": "accel",
}


R_HEADERS = {
    "write.table": ('"time" "gyro_x" "gyro_y" "gyro_z"', '"{0}" {1}', " "),
    "write.table without quotes": ("time gyro_x gyro_y gyro_z", "{0} {1}", " "),
    "names of rows": ('"time" "gyro_x" "gyro_y" "gyro_z"', '"row{0}" {1}', " "),
    "write.table with tabs": ("time\tgyro_x\tgyro_y\tgyro_z", "{0}\t{1}", "\t"),
    "write.csv": ('"","time","gyro_x","gyro_y","gyro_z"', '"{0}",{1}', ","),
    "pandas": (",time,gyro_x,gyro_y,gyro_z", "{0},{1}", ","),
}


@pytest.mark.filterwarnings("ignore::gmwm.errors.GmwmWarning")
@pytest.mark.parametrize("kind", R_HEADERS)
def test_row_names(tmp_path, kind):
    header, form, sep = R_HEADERS[kind]
    rows = [sep.join(map(str, (SECONDS[k], *GYRO[k]))) for k in K]
    rows[50] = sep.join(["0.5", "NA", "0.1", "0.1"])
    (tmp_path / "r.txt").write_text(
        "\n".join([header, *(form.format(k + 1, row) for k, row in enumerate(rows))]) + "\n"
    )
    imu = read(tmp_path / "r.txt", units={"gyro": "rad/s"})
    assert imu.segments == ((0, 50), (50, ROWS - 1))
    assert imu["gyro_z"].values.tolist() == np.delete(GYRO[:, 2], 50).tolist()


@pytest.mark.slow
def test_several_sensors_in_the_rows_of_a_table(tmp_path):
    two, other = np.repeat(K, 2), np.array([[0], [1]] * ROWS)
    header = "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ"
    text = table(header, US[two], [0, 1] * ROWS, GYRO[two] + other, ACCEL[two])
    path = tmp_path / "imu.csv"
    path.write_text(text)
    with raises(ReadError, "2 recordings", "I=0 (gyro_x", code="several-recordings", advises=["topic="]):
        read(path)
    second = read(path, topic="I=1")
    assert (second.rate, len(second)) == (100, ROWS)
    assert second["gyro_x"].values == pytest.approx(GYRO[:, 0] + 1)
    assert sum(map(len, stream(path, topic="I=0"))) == ROWS
    (tmp_path / "imu.csv.gz").write_bytes(gzip.compress(text.encode()))
    assert len(read(tmp_path / "imu.csv.gz", topic="I=0")) == ROWS
    with zipfile.ZipFile(tmp_path / "imu.zip", "w") as archive:
        archive.write(path, "imu.csv")
    assert len(read(tmp_path / "imu.zip", topic="imu/I=1")) == ROWS


def test_counts_of_betaflight_need_a_unit(tmp_path):
    header = "loopIteration, time (us), gyroADC[0], gyroADC[1], gyroADC[2], stateFlags (flags)"
    (tmp_path / "a.csv").write_text(table(header, K, US, (DEG * 10).astype(int), [""] * ROWS, sep=", "))
    with raises(UnitError, "gyro_x, gyro_y, gyro_z", "declared"):
        read(tmp_path / "a.csv")
    assert read(tmp_path / "a.csv", units={"gyro": "deg/s"}, scale={"gyro": 0.1}).rate == 100


def test_columns_without_names_are_guessed_by_gravity(tmp_path):
    (tmp_path / "a.log").write_text(table("", ACCEL, GYRO).lstrip())
    with raises(ReadError, code="columns-unnamed", advises=["columns=['accel_x', 'accel_y', 'accel_z', 'gyro_x'"]):
        read(tmp_path / "a.log")
    (tmp_path / "b.log").write_text(table("", SECONDS, GYRO, ACCEL).lstrip())
    with raises(ReadError, code="columns-unnamed", advises=["columns=['time', 'gyro_x', 'gyro_y'"]):
        read(tmp_path / "b.log")
