"""Simulate recordings and signals with known noise and known latent processes."""

from gmwm.simulation.api import models_by_axis, simulate, simulate_signal
from gmwm.simulation.components import SimulatedImu, SimulatedSignal
from gmwm.simulation.reference import example_recording, reference_imu

__all__ = [
    "SimulatedImu",
    "SimulatedSignal",
    "example_recording",
    "models_by_axis",
    "reference_imu",
    "simulate",
    "simulate_signal",
]
