"""The error equations of inertial navigation against numerical derivatives of the strapdown equations."""

import numpy as np
import pytest

from gmwm.applications.navigation.api import navigation
from gmwm.base.units import AXES

RADIUS, EARTH_RATE, GRAVITY = 6.371e6, 7.292115e-5, 9.81
STEPS = np.array([1e-4] * 3 + [1.0] * 3 + [100.0] * 3)  # rad, m/s, m


def _cross(v):
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def _rotation(phi):
    from scipy.linalg import expm

    return expm(-_cross(phi))


def _strapdown(attitude, velocity, position, gyro, accel):
    """Derivatives of attitude (body to north, east, down), velocity (m/s) and position (latitude, longitude, height).

    The Earth is a sphere, and gravity decreases with the square of the distance from its centre.
    """
    latitude, _, height = position
    north, east, down = velocity
    distance = RADIUS + height
    earth = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    transport = np.array([east, -north, -east * np.tan(latitude)]) / distance
    gravity = np.array([0.0, 0.0, GRAVITY * (RADIUS / distance) ** 2])
    turning = attitude @ _cross(gyro) - _cross(earth + transport) @ attitude
    acceleration = attitude @ accel - np.cross(2 * earth + transport, velocity) + gravity
    return turning, acceleration, np.array([north / distance, east / (distance * np.cos(latitude)), -down])


def _error_rate(errors, gyro_error, accel_error, latitude):
    """Derivative of the nine errors of a level vehicle at rest; its computed attitude is (I - [φ×]) times the truth."""
    earth = EARTH_RATE * np.array([np.cos(latitude), 0.0, -np.sin(latitude)])
    metres = np.array([RADIUS, RADIUS * np.cos(latitude), -1.0])
    attitude, velocity = _rotation(errors[:3]), errors[3:6]
    position = np.array([latitude, 0.0, 0.0]) + errors[6:] / metres
    gyro, accel = earth + gyro_error, np.array([0.0, 0.0, -GRAVITY]) + accel_error
    turning, acceleration, travel = _strapdown(attitude, velocity, position, gyro, accel)
    return np.array([-turning[2, 1], -turning[0, 2], -turning[1, 0], *acceleration, *(metres * travel)])


@pytest.mark.parametrize("latitude", [0.0, 0.84, -0.6])
def test_the_error_matrix_is_the_derivative_of_the_strapdown_equations(latitude):
    """All 81 elements of the matrix agree within 1e-4."""
    zero = np.zeros(3)
    numerical = np.empty((9, 9))
    for k, (step, unit) in enumerate(zip(STEPS, np.eye(9), strict=True)):
        ends = [_error_rate(sign * step * unit, zero, zero, latitude) for sign in (1, -1)]
        numerical[:, k] = (ends[0] - ends[1]) / (2 * step)
    matrix = navigation("gyro_x", GRAVITY, latitude).a
    scale = np.maximum(np.abs(numerical), 1e-12)
    assert np.all(np.abs(matrix - numerical) / scale < 1e-4 + 1e-13 / scale), (matrix - numerical) / scale


@pytest.mark.parametrize("axis", AXES)
def test_a_sensor_error_acts_as_in_the_strapdown_equations(axis):
    unit = np.eye(3)[AXES.index(axis) % 3] * 1e-6
    gyro, accel = (unit, np.zeros(3)) if axis.startswith("gyro") else (np.zeros(3), unit)
    response = navigation(axis, GRAVITY, 0.84)
    change = _error_rate(np.zeros(9), gyro, accel, 0.84) - _error_rate(np.zeros(9), np.zeros(3), np.zeros(3), 0.84)
    np.testing.assert_allclose(response.drive, change / 1e-6, atol=1e-6)
    if not response.removed:  # the tilt from levelling makes the computed horizontal acceleration zero
        tilted = _error_rate(np.where(np.arange(9) < 3, response.at_start, 0.0) * 1e-6, gyro, accel, 0.84)
        np.testing.assert_allclose(tilted[3:5], 0.0, atol=1e-11)
