"""The question for the unit of gyroscopes: what each unit would mean, and what the recording says about it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gmwm.base.arrays import Vector
from gmwm.base.errors import UnitError
from gmwm.base.units import SI_UNIT
from gmwm.files.columns.scale_factors import offset_words

_TYPICAL = (
    (1e-6, 0.0005, "fibre-optic and ring laser gyroscopes of navigation grade"),
    (0.0005, 0.003, "tactical gyroscopes such as STIM300 (0.0025)"),
    (0.003, 0.02, "gyroscopes such as MPU-6050 (0.005), BMI160 (0.007) and BMI088 (0.014)"),
    (0.02, 0.1, "gyroscopes such as L3GD20 (0.03)"),
)
"""Noise densities (deg/s/√Hz) in the datasheets of usual gyroscopes. They explain the question and decide nothing."""
_USUAL = (0.003, 0.1)
"""Noise densities (deg/s/√Hz) of gyroscopes in phones, drones and most loggers. A unit that gives one comes first."""
_QUIET_SHARE = 0.1
"""Share of windows that are quieter than the one whose noise is stated, so that motion elsewhere does not matter."""
_CLEAR = 0.7
"""Correlation between turns of gravity and gyroscopes above which the turns are a witness. Both are noise at rest;
pinned by tests/readers/test_units.py."""


def unknown_gyro(axes: Sequence[str], values: Mapping[str, Vector], rate: float) -> UnitError:
    """Make the error for gyroscopes without a unit. It states the noise density of the quietest part for both units,
    and the unit with which the turns of gravity agree. `values` (N,) are the numbers in the file, `rate` is in Hz."""
    density = float(np.median([_quiet_density(values[axis], rate) for axis in axes]))
    densities = {"deg/s": density, "rad/s": math.degrees(density)}
    readings = "; ".join(_reading(unit, value) for unit, value in densities.items())
    likely = _by_turns(values, rate)
    witness = f". The turns of gravity agree with {likely}" if likely else offset_words(axes, values)
    usual = [likely] if likely else [unit for unit, value in densities.items() if _USUAL[0] <= value < _USUAL[1]]
    first = usual[0] if len(usual) == 1 else ""
    other = next(unit for unit in densities if unit != (first or "deg/s"))
    return UnitError(
        f"the unit of {', '.join(axes)} is neither declared nor named in the file. In the quietest part, the noise "
        f"density is {readings}{witness}",
        code="unit-unnamed",
        advice=(
            f"It is probably {{--units=gyro:{first}}}, otherwise {{--units=gyro:{other}}}."
            if first
            else "State it with {--units=gyro:deg/s} or {--units=gyro:rad/s}."
        ),
    )


def _reading(unit: str, density: float) -> str:
    """Describe a noise density (deg/s/√Hz), and the gyroscopes that have it."""
    parts = _parts(density)
    typical = f"typical of {parts}" if parts else "which no usual gyroscope has"
    return f"{density:.3g} deg/s/√Hz ({60 * density:.3g} deg/√h) if it is {unit}, {typical}"


def _parts(density: float) -> str:
    """Return the usual gyroscopes with a noise density (deg/s/√Hz); "" if there are none."""
    return next((parts for low, high, parts in _TYPICAL if low <= density < high), "")


def _quiet_density(samples: Vector, rate: float) -> float:
    """Return the white noise density of the quiet windows, from first differences, which do not depend on the bias."""
    differences = np.diff(samples)
    width = max(32, min(round(rate), differences.size // 8))
    count = max(1, differences.size // width)
    windows = differences[: count * width].reshape(count, -1) if differences.size >= width else differences[None]
    with np.errstate(over="ignore", invalid="ignore"):
        return float(np.quantile(np.std(windows, axis=1), _QUIET_SHARE)) / math.sqrt(2 * rate)


def _by_turns(values: Mapping[str, Vector], rate: float) -> str:
    """Return the unit of the gyroscopes with which the turns of gravity agree: a body that turns with the rate ω sees
    the direction g turn with −ω × g. "" if the recording has not all axes, or no clear turns."""
    if not all(f"{sensor}_{axis}" in values for sensor in SI_UNIT for axis in "xyz"):
        return ""
    width = max(1, round(rate / 10))  # samples in 0.1 s, over which noise and vibration average out
    count = values["gyro_x"].size // width
    if count < 16:
        return ""
    gyro, accel = (
        np.column_stack(
            [values[f"{sensor}_{axis}"][: count * width].reshape(count, width).mean(axis=1) for axis in "xyz"]
        )
        for sensor in ("gyro", "accel")
    )
    with np.errstate(all="ignore"):
        down = accel / np.linalg.norm(accel, axis=1, keepdims=True)
        turns = np.diff(down, axis=0) * rate / width
        expected = -np.cross((gyro[1:] + gyro[:-1]) / 2, (down[1:] + down[:-1]) / 2)
        product, power = float(np.sum(turns * expected)), float(np.sum(expected**2))
        correlation = product / math.sqrt(power * float(np.sum(turns**2)) or 1.0)
    if not abs(correlation) > _CLEAR:
        return ""
    size = abs(product) / power
    return next((unit for unit, factor in (("rad/s", 1.0), ("deg/s", math.pi / 180)) if 0.5 < size / factor < 2), "")
