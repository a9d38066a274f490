from __future__ import annotations

from gmwm.files.columns.column_names import is_unit, named_unit, recognise
from tests.helpers import each

AXES = {
    "gyro_x": "gyro_x Gyr_X GYRO_X gyroX GyroX gx wx w_x omega_x angular_velocity.x angular_velocity_x xgyro "
    "imu0_gyro_x field.angular_velocity.x w_RS_S_x gyroscope_x x_gyro AngVelX gyro_raw_x gyro.x imu.gyro_rate_x "
    "gyroADC[0] gyro_xyz[0] gyro_x[1]",
    "accel_z": "accel_z Acc_Z ACC_Z accZ az a_z alpha_z linear_acceleration.z zacc acceleration_z accelerometer_z "
    "a_RS_S_z fz specific_force_z imu/accel/z accel_z_raw "
    "accSmooth[2] accel_z[0]",
    "time": "time t Time timestamp %time #timestamp time_s stamp header.stamp seconds_elapsed field.header.stamp tow",
    "temperature": "temperature Temp imu_temp",
    "": "mag_x x seq frame_id gyro_x_std accel_bias_x orientation.x delta_angle_x index gyro velocity_x max "
    "gravity_x angular_acceleration_x temp_new temp_std header.stamp.sec header.stamp.nanosec VelInc_X cov_gyro_x",
}


@each(("axis", "name"), [(axis, name) for axis, names in AXES.items() for name in names.split()])
def test_axis_by_name(axis, name):
    assert recognise(name).axis == axis


@each(
    ("name", "unit"),
    [
        ("gyro_x [deg/s]", "deg/s"), ("gyro_x (rad/s)", "rad/s"), ("gyro_x_dps", "deg/s"), ("gx_rad_s", "rad/s"),
        ("GyroX_radps", "rad/s"), ("w_RS_S_x [rad s^-1]", "rad/s"), ("Gyroscope x (rad/s)", "rad/s"),
        ("gyro_x °/s", "deg/s"), ("gyro_x_mdps", "mdeg/s"), ("wz(°/h)", "deg/h"), ("ax_mps2", "m/s²"),
        ("a_RS_S_x [m s^-2]", "m/s²"), ("acc_x_g", "g"), ("AccX (m/s²)", "m/s²"), ("acc_x [mg]", "mg"),
        ("accel_x_m_s2", "m/s²"), ("time_us", "us"), ("t_ms", "ms"), ("timestamp [ns]", "ns"), ("Time (s)", "s"),
        ("sensor_time_ns", "ns"), ("time", ""), ("gyro_x", ""), ("gyro_x [g]", ""), ("temp [°C]", "°C"),
        ("temp_F", "°F"), ("Temperature (K)", "K"), ("imu_temp [deg F]", "°F"), ("temperature [mdegC]", "m°C"),
        ("temp (m°C)", "m°C"), ("gyro x (0.1 dps)", "0.1 dps"), ("GForceX (g)", "g"),
    ],
)  # fmt: skip
def test_unit_by_name(name, unit):
    assert recognise(name).axis
    assert recognise(name).unit == unit


def test_a_unit_counts_for_the_axis_the_column_was_taken_for():
    assert named_unit("ch1 [dps]", "gyro_y") == "deg/s"
    assert named_unit("ch1 [dps]", "accel_y") == ""
    assert named_unit("gyro_x [dps]", "gyro_y") == "deg/s"


def test_what_is_a_unit():
    assert all(map(is_unit, ["s", "[ns]", "(deg/s)", "g", "m/s^2", "degC"]))
    assert not any(map(is_unit, ["", "gyro_x", "1.5", "time"]))
