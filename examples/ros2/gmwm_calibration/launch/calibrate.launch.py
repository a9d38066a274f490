from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

DEFAULTS = {"topic": "/imu/data", "duration": "3600.0", "output": "imu_calibration", "format": "kalibr"}


def generate_launch_description():
    values = {name: LaunchConfiguration(name) for name in DEFAULTS}
    node = Node(
        package="gmwm_calibration", executable="calibrate_at_rest", output="screen", parameters=[values]
    )  # fmt: skip
    arguments = [DeclareLaunchArgument(name, default_value=text) for name, text in DEFAULTS.items()]
    return LaunchDescription([*arguments, node])
