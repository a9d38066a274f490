"""Static recordings with known truth: each axis of an IMU is a path of its own model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from gmwm._arrays import Vector, as_rate
from gmwm.errors import GmwmError, ModelError, OptionError
from gmwm.processes.base import Process
from gmwm.processes.markov import GM
from gmwm.processes.model import Model, ModelLike, as_model
from gmwm.processes.noise import QN, WN
from gmwm.processes.walk import RW
from gmwm.signals import AXES, MINIMUM_SAMPLES, Imu, axis_quantity
from gmwm.units import SI_UNIT, STANDARD_GRAVITY

T = TypeVar("T")

_PLACES = (*SI_UNIT, *AXES)
_ACCELEROMETERS = tuple(axis for axis in AXES if axis_quantity(axis) == "accel")


def simulate(
    models: Mapping[str, ModelLike] | ModelLike,
    *,
    rate: float,
    seed: int,
    duration: float | None = None,
    samples: int | None = None,
    resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z",
) -> Imu:
    """A static recording whose noise is known: X_t = Σ_k X_t^(k) on each axis, from that axis' model.

    Every axis draws from its own stream of `seed`, so that gyro_y is the same path whichever other axes are
    simulated with it.

    Parameters
    ----------
    models : mapping of axis to model, or one model
        Complete models with variances in (rad/s)² or (m/s²)² per sample, or their texts. The keys are axes, or
        "gyro" and "accel" for three axes at once (an axis named by itself goes before). One model alone is
        that of all six axes.
    rate : float
        Samples per second (Hz).
    seed : int
        Not negative; the same seed gives the same recording.
    duration : float, optional
        Length (s); give this or `samples`.
    samples : int, optional
        Length (samples), at least 8.
    resolution : mapping, optional
        Least significant bit of the output (rad/s or m/s²) by axis or sensor: each sample is rounded to it,
        which adds white noise of variance resolution²/12. None is rounded by default.
    gravity : axis or None
        The accelerometer that carries 9.80665 m/s², if it is simulated; None for no gravity at all.

    Returns
    -------
    Imu
        The recording in SI units; its notes state the truth of each axis and the seed.

    Raises
    ------
    OptionError
        If an argument cannot be used.
    ModelError
        If a model has a parameter without a value, or a process that cannot be simulated.

    Examples
    --------
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-8) + RW(gamma2=1e-14)"}, rate=100.0, duration=10.0, seed=1)
    >>> imu
    Imu(gyro_x: 1000 samples at 100 Hz, 10 s)
    >>> imu.notes[0]
    'gyro_x is simulated: WN(sigma2=4e-08) + RW(gamma2=1e-14)'
    """
    rate = as_rate(rate)
    n = _length(rate, duration, samples)
    truth = models_by_axis(models)
    steps = {axis: _step(axis, value) for axis, value in _by_axis(resolution or {}, "resolution").items()}
    if gravity is not None and gravity not in _ACCELEROMETERS:
        raise OptionError(f"gravity must be one of {', '.join(_ACCELEROMETERS)} or None, got {gravity!r}")
    if isinstance(seed, bool) or not isinstance(seed, int | np.integer) or seed < 0:
        raise OptionError(f"seed must be an integer that is not negative, got {seed!r}")
    streams = dict(zip(AXES, np.random.SeedSequence(int(seed)).spawn(len(AXES)), strict=True))

    arrays = {}
    for axis, model in truth.items():
        path = _path(axis, model, n, rate, np.random.default_rng(streams[axis]))
        if axis == gravity:
            path += STANDARD_GRAVITY
        arrays[axis] = _rounded(path, steps[axis]) if axis in steps else path
    imu = Imu.from_arrays(arrays, rate, source=f"simulation with seed {seed}")
    notes = [f"{axis} is simulated: {truth[axis]}" for axis in imu.axes]
    return replace(imu, notes=(*notes, f"seed {seed}; an axis draws from its own stream of it"))


def models_by_axis(models: Mapping[str, ModelLike] | ModelLike) -> dict[str, Model]:
    """The model of each axis, in the order of the axes, from what `simulate` takes.

    >>> models_by_axis({"gyro": "WN(sigma2=1.0)", "gyro_y": "QN(q2=2.0)"})
    {'gyro_x': Model('WN(sigma2=1.0)'), 'gyro_y': Model('QN(q2=2.0)'), 'gyro_z': Model('WN(sigma2=1.0)')}
    """
    if isinstance(models, str | Process | Model):
        return dict.fromkeys(AXES, as_model(models))
    if not isinstance(models, Mapping) or not models:
        raise OptionError(
            "models must map axes to models, as {'gyro': 'WN(sigma2=4e-8)'}, or be one model for all axes; "
            f"got {models!r}"
        )
    return {axis: as_model(model) for axis, model in _by_axis(models, "models").items()}


def reference_imu() -> dict[str, Model]:
    """The models of a good MEMS unit at 100 Hz: the truth that `gmwm demo` simulates and finds again.

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


def _by_axis(given: Mapping[str, T], name: str) -> dict[str, T]:
    """One value for each axis that is named, by itself or as one of a sensor's."""
    unknown = [key for key in given if key not in _PLACES]
    if unknown:
        raise OptionError(f"{name} must be given for {', '.join(_PLACES)}; got {unknown[0]!r}")
    of = {axis: axis if axis in given else axis[:-2] for axis in AXES}
    return {axis: given[key] for axis, key in of.items() if key in given}


def _length(rate: float, duration: float | None, samples: int | None) -> int:
    if (duration is None) == (samples is None):
        got = "neither" if duration is None else f"duration={duration!r} and samples={samples!r}"
        raise OptionError(f"give the length as duration= (s) or as samples=, one of them; got {got}")
    if duration is not None:
        if not (math.isfinite(duration) and duration > 0):
            raise OptionError(f"duration must be positive and finite (s), got {duration!r}")
        n, came = (
            round(duration * rate),
            f"duration={duration:g} at {rate:g} Hz, {round(duration * rate)} samples",
        )
    else:
        if isinstance(samples, bool) or not isinstance(samples, int | np.integer):
            raise OptionError(f"samples must be an integer, got {samples!r}")
        n, came = int(samples), f"samples={samples}"
    if n < MINIMUM_SAMPLES:
        raise OptionError(f"a recording needs at least {MINIMUM_SAMPLES} samples, got {came}")
    return n


def _path(axis: str, model: Model, n: int, rate: float, rng: np.random.Generator) -> Vector:
    open_ends = [name for name, value in model.parameters.items() if value is None]
    if open_ends:
        process = next(process for process in model.processes if not process.is_complete)
        values = (f"{name}={'…' if value is None else f'{value:g}'}" for name, value in process.values.items())
        raise ModelError(
            f"{axis}: a simulation needs every value of its model, {model} has none for {', '.join(open_ends)}; "
            f'write them in it, as "{process.name}({", ".join(values)})"'
        )
    try:
        return np.asarray(model.simulate(n, rate, rng), dtype=np.float64)
    except GmwmError as error:
        raise type(error)(f"{axis}: {error}") from None


def _step(axis: str, step: float) -> float:
    if not (math.isfinite(step) and step > 0):
        raise OptionError(f"resolution of {axis} must be positive and finite, got {step!r}")
    return float(step)


def _rounded(path: Vector, step: float) -> Vector:
    """To the nearest multiple of `step`."""
    inverse = round(1 / step)
    # The quotient by a whole number is the double nearest to a decimal such as 0.0123: short in a text file.
    if inverse and math.isclose(inverse * step, 1, rel_tol=1e-12):
        return np.asarray(np.rint(path * inverse) / inverse)
    return np.asarray(np.rint(path / step) * step)
