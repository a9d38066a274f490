"""Node that records an IMU at rest for a time, calibrates it, and writes the recording, the report and imu.yaml."""

from array import array
from pathlib import Path

import numpy as np
import rclpy
from rclpy.node import Node
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu as ImuMessage

import gmwm

AXES = ("gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z")
NANOSECONDS = 1_000_000_000


class CalibrateAtRest(Node):
    """Node with the parameters topic, duration (s), output (folder) and format (of the file for the filter)."""

    def __init__(self):
        super().__init__("calibrate_at_rest")
        topic = self.declare_parameter("topic", "/imu/data").value
        self.duration = float(self.declare_parameter("duration", 3600.0).value)
        self.output = Path(self.declare_parameter("output", "imu_calibration").value)
        self.format = self.declare_parameter("format", "kalibr").value
        self.stamps, self.values, self.done = array("q"), array("d"), False
        self.create_subscription(ImuMessage, topic, self.add, qos_profile_sensor_data)
        self.get_logger().info(f"recording {topic} for {self.duration:g} s; keep the sensor at rest")

    def add(self, message):
        """Keep the numbers of a message, and end when the recording is long enough."""
        stamp = message.header.stamp
        self.stamps.append(stamp.sec * NANOSECONDS + stamp.nanosec)
        for vector in (message.angular_velocity, message.linear_acceleration):
            self.values.extend((vector.x, vector.y, vector.z))
        self.done = self.stamps[-1] - self.stamps[0] >= self.duration * NANOSECONDS

    def recording(self):
        """Return what was recorded, with the time stamps of the messages."""
        columns = np.array(self.values).reshape(-1, len(AXES)).T
        stamps = np.array(self.stamps)
        time = (stamps - stamps[0]).astype("m8[ns]")
        return gmwm.Imu.from_arrays({"time": time, **dict(zip(AXES, columns, strict=True))}, source="ROS 2")

    def calibrate(self):
        """Calibrate the recording, and write recording.parquet, calibration.json, report.html and imu.yaml."""
        self.output.mkdir(parents=True, exist_ok=True)
        imu = self.recording()
        imu.write(self.output / "recording.parquet")
        calibration = gmwm.calibrate(imu)
        calibration.save(self.output / "calibration.json")
        calibration.report(self.output / "report.html")
        calibration.export(self.output / "imu.yaml", format=self.format)
        self.get_logger().info(f"{calibration.verdict.text()} Files: {self.output.resolve()}")


def main():
    """Record until the time is over or Ctrl-C, then calibrate."""
    rclpy.init()
    node = CalibrateAtRest()
    try:
        while rclpy.ok() and not node.done:
            rclpy.spin_once(node, timeout_sec=1.0)
    except KeyboardInterrupt:
        pass
    if len(node.stamps):
        node.calibrate()
    node.destroy_node()
    rclpy.try_shutdown()
