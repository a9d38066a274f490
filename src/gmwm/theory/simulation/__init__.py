"""Simulate recordings and signals with known noise and known latent processes."""

from gmwm.theory.simulation.api import example_recording, models_by_axis, reference_imu, simulate, simulate_signal
from gmwm.theory.simulation.components import SimulatedImu, SimulatedSignal

__all__ = [
    "SimulatedImu", "SimulatedSignal", "example_recording", "models_by_axis", "reference_imu", "simulate",
    "simulate_signal",
]  # fmt: skip
