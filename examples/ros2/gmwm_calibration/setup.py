from setuptools import setup

NAME = "gmwm_calibration"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/calibrate.launch.py"]),
    ],
    install_requires=["setuptools", "gmwm"],
    zip_safe=True,
    description="Records an IMU at rest, calibrates its noise with gmwm, and writes imu.yaml",
    license="BSD-3-Clause",
    entry_points={"console_scripts": [f"calibrate_at_rest = {NAME}.calibrate_at_rest:main"]},
)
