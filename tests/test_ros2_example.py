"""The example of a ROS 2 package, with a stand-in for rclpy, which no package index has."""

import importlib.util
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import gmwm

PACKAGE = Path(__file__).resolve().parent.parent / "examples" / "ros2" / "gmwm_calibration"
PARAMETERS = {"duration": 60.0, "topic": "/imu"}


class Node:
    """What the example uses of a node of rclpy."""

    def __init__(self, name):
        self.log = []

    def declare_parameter(self, name, value):
        return SimpleNamespace(value=PARAMETERS.get(name, value))

    def create_subscription(self, kind, topic, callback, quality):
        assert topic == "/imu"

    def get_logger(self):
        return SimpleNamespace(info=self.log.append)

    def destroy_node(self):
        pass


@pytest.fixture
def module(monkeypatch):
    ros = {
        "rclpy": {"init": lambda: None, "ok": lambda: True, "try_shutdown": lambda: None},
        "rclpy.node": {"Node": Node}, "rclpy.qos": {"qos_profile_sensor_data": None},
        "sensor_msgs": {}, "sensor_msgs.msg": {"Imu": object},
    }  # fmt: skip
    for name, content in ros.items():
        stand_in = ModuleType(name)
        stand_in.__dict__.update(content)
        monkeypatch.setitem(sys.modules, name, stand_in)
    path = PACKAGE / "gmwm_calibration" / "calibrate_at_rest.py"
    specification = importlib.util.spec_from_file_location("calibrate_at_rest", path)
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.slow
def test_the_node_writes_the_files_of_a_calibration(module, tmp_path, monkeypatch):
    truth = {"gyro": "WN(sigma2=4e-7)", "accel": "WN(sigma2=1e-4)"}
    imu = gmwm.simulate(truth, rate=100.0, samples=20_000, rng=1)
    columns = np.column_stack([imu[axis].values for axis in module.AXES])
    messages = iter(enumerate(columns.tolist()))

    def spin_once(node, timeout_sec):
        k, row = next(messages)
        stamp = SimpleNamespace(sec=1_700_000_000 + k // 100, nanosec=k % 100 * 10_000_000)
        vectors = [SimpleNamespace(**dict(zip("xyz", part, strict=True))) for part in (row[:3], row[3:])]
        node.add(
            SimpleNamespace(
                header=SimpleNamespace(stamp=stamp), angular_velocity=vectors[0], linear_acceleration=vectors[1]
            )
        )

    monkeypatch.setattr(module.rclpy, "spin_once", spin_once, raising=False)
    monkeypatch.chdir(tmp_path)
    module.main()
    folder = tmp_path / "imu_calibration"
    assert {file.name for file in folder.iterdir()} == {
        "recording.parquet", "calibration.json", "report.html", "imu.yaml",
    }  # fmt: skip
    assert gmwm.read(folder / "recording.parquet").duration == pytest.approx(60.01)
    assert "gyroscope_noise_density" in (folder / "imu.yaml").read_text(encoding="utf-8")


def test_the_description_of_the_package_has_what_colcon_needs():
    described = ElementTree.parse(PACKAGE / "package.xml").getroot()
    name = described.findtext("name")
    assert described.findtext("export/build_type") == "ament_python"
    assert (PACKAGE / "resource" / name).is_file()
    assert f"$base/lib/{name}" in (PACKAGE / "setup.cfg").read_text(encoding="utf-8")
    for file in (PACKAGE / "setup.py", PACKAGE / "launch" / "calibrate.launch.py"):
        compile(file.read_text(encoding="utf-8"), str(file), "exec")
