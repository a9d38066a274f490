"""Simulate recordings and signals with known noise and known latent processes."""

from gmwm.theory.simulation.api import (
    SimulatedImu,
    SimulatedSignal,
    example_recording,
    models_by_axis,
    reference_imu,
    simulate,
    simulate_signal,
)

__all__ = [
    "SimulatedImu", "SimulatedSignal", "example_recording", "models_by_axis", "reference_imu", "simulate",
    "simulate_signal",
]  # fmt: skip
