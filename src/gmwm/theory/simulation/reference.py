"""Noise models of the inertial unit that the demo and the examples simulate."""

from __future__ import annotations

from gmwm.recording.signals import Imu
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model
from gmwm.theory.processes.noise import QN, WN
from gmwm.theory.processes.walk import RW
from gmwm.theory.simulation.api import simulate


def example_recording() -> Imu:
    """Return a simulated recording of the unit of `reference_imu` at rest, ten minutes at 100 Hz; always the same one.

    >>> imu = example_recording()
    >>> imu["gyro_y"]
    Signal(gyro_y, 60000 samples at 100 Hz, rad/s)
    """
    return simulate(reference_imu(), rate=100.0, duration=600.0, rng=1)


def reference_imu() -> dict[str, Model]:
    """Return the noise models of a good MEMS unit at 100 Hz, which `gmwm demo` simulates and then estimates.

    Gyroscopes: white noise (angular random walks of 0.22 to 0.27 deg/√h), quantization of the angle on x,
    Gauss-Markov processes with correlation times from 0.1 to 5 s, and a rate random walk on y. Accelerometers:
    white noise (velocity random walks of 0.027 to 0.033 m/s/√h), quantization on z, Gauss-Markov processes on x
    and y, and a random walk on x and z.

    >>> reference_imu()["gyro_z"].structure
    'WN + 2*GM'
    """
    return {
        "gyro_x": QN(q2=2.5e-7) + WN(sigma2=6e-7) + GM(beta=0.2, sigma2=2e-8),
        "gyro_y": WN(sigma2=4e-7) + GM(beta=4.0, sigma2=3e-8) + RW(gamma2=2e-11),
        "gyro_z": WN(sigma2=5e-7) + GM(beta=8.0, sigma2=5e-8) + GM(beta=0.2, sigma2=1e-8),
        "accel_x": WN(sigma2=3e-5) + GM(beta=6.0, sigma2=2e-6) + RW(gamma2=2.5e-10),
        "accel_y": WN(sigma2=2.5e-5) + GM(beta=8.0, sigma2=3e-6) + GM(beta=0.2, sigma2=4e-7),
        "accel_z": QN(q2=1e-5) + WN(sigma2=2e-5) + RW(gamma2=5e-11),
    }
