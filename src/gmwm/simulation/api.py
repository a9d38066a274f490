"""Paths of models: each axis of a static recording from its own one, or a single signal."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from typing import Literal, TypeVar, overload

import numpy as np

from gmwm._arrays import Vector, as_rate
from gmwm.axis_names import AXES, axis_quantity
from gmwm.errors import GmwmError, ModelError, OptionError
from gmwm.processes.base import Process
from gmwm.processes.model import Model, ModelLike, as_model
from gmwm.processes.validation import as_rng, as_seed
from gmwm.remarks import Remark
from gmwm.signals import MINIMUM_SAMPLES, Imu, Signal
from gmwm.simulation.components import SimulatedImu, SimulatedSignal
from gmwm.units import SI_UNIT, STANDARD_GRAVITY

T = TypeVar("T")

_PLACES = (*SI_UNIT, *AXES)
_ACCELEROMETERS = tuple(axis for axis in AXES if axis_quantity(axis) == "accel")


@overload
def simulate(
    models: Mapping[str, ModelLike] | ModelLike,
    *,
    rate: float,
    rng: int | np.random.Generator,
    duration: float | None = None,
    samples: int | None = None,
    resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z",
    components: Literal[False] = False,
) -> Imu: ...
@overload
def simulate(
    models: Mapping[str, ModelLike] | ModelLike,
    *,
    rate: float,
    rng: int | np.random.Generator,
    duration: float | None = None,
    samples: int | None = None,
    resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z",
    components: Literal[True],
) -> SimulatedImu: ...
def simulate(
    models: Mapping[str, ModelLike] | ModelLike,
    *,
    rate: float,
    rng: int | np.random.Generator,
    duration: float | None = None,
    samples: int | None = None,
    resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z",
    components: bool = False,
) -> Imu | SimulatedImu:
    """A static recording whose noise is known: X_t = Σ_k X_t^(k) on each axis, from that axis' model.

    Every axis draws from its own stream of `rng`, so that gyro_y is the same path whichever other axes are
    simulated with it.

    Parameters
    ----------
    models : mapping of axis to model, or one model
        Complete models with variances in (rad/s)² or (m/s²)² per sample, or their texts. The keys are axes, or
        "gyro" and "accel" for three axes at once (an axis named by itself goes before). One model alone is
        that of all six axes.
    rate : float
        Samples per second (Hz).
    rng : int or numpy.random.Generator
        Source of the draws; the same integer gives the same recording. Of a Generator an integer is drawn, which the
        notes of the recording state.
    duration : float, optional
        Length (s); give this or `samples`.
    samples : int, optional
        Length (samples), at least 8.
    resolution : mapping, optional
        Least significant bit of the output (rad/s or m/s²) by axis or sensor: each sample is rounded to it,
        which adds white noise of variance resolution²/12. None is rounded by default.
    gravity : axis or None
        The accelerometer that carries 9.80665 m/s², if it is simulated; None for no gravity at all.
    components : bool
        Whether to return the latent process of each term as well. The recording is the same either way.

    Returns
    -------
    Imu, or SimulatedImu with `components=True`
        The recording in SI units; its remarks state the model of each axis and the seed. A `SimulatedImu` holds it as
        `imu`, and the latent processes as `components["gyro_x"]["WN"]`.

    Raises
    ------
    OptionError
        If an argument cannot be used.
    ModelError
        If a model has a parameter without a value, or a process that cannot be simulated.

    Examples
    --------
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-8) + RW(gamma2=1e-14)"}, rate=100.0, duration=10.0, rng=1)
    >>> imu
    Imu(gyro_x: 1000 samples at 100 Hz, 10 s)
    >>> imu.remarks[0].facts
    {'model': 'WN(sigma2=4e-08) + RW(gamma2=1e-14)', 'seed': 1}
    >>> simulated = simulate({"gyro": "WN(sigma2=4e-8)"}, rate=100.0, duration=10.0, rng=1, components=True)
    >>> simulated["gyro_x"]["WN"]
    Signal(gyro_x WN, 1000 samples at 100 Hz, rad/s)
    """
    rate, seed = as_rate(rate), as_seed(rng)
    n = _length(rate, duration, samples)
    truth = models_by_axis(models)
    steps = {axis: _step(axis, value) for axis, value in _by_axis(resolution or {}, "resolution").items()}
    if gravity is not None and gravity not in _ACCELEROMETERS:
        raise OptionError(f"gravity must be one of {', '.join(_ACCELEROMETERS)} or None, got {gravity!r}")
    streams = dict(zip(AXES, np.random.SeedSequence(seed).spawn(len(AXES)), strict=True))

    arrays, made = {}, {}
    for axis, model in truth.items():
        generator = np.random.default_rng(streams[axis])
        _require_values(axis, model)
        offset = STANDARD_GRAVITY if axis == gravity else 0.0
        with _named(axis):
            if components:
                unit = SI_UNIT[axis_quantity(axis)]
                made[axis] = _simulated(
                    model, n, rate, generator, unit=unit, axis=axis, offset=offset, step=steps.get(axis)
                )
                arrays[axis] = made[axis].signal.values
            else:
                arrays[axis] = _finished(model.simulate(n, rate, generator), offset, steps.get(axis))
    imu = Imu.from_arrays(arrays, rate, source=f"simulation with seed {seed}")
    remarks = tuple(Remark.of("simulated", axis, model=str(truth[axis]), seed=seed) for axis in imu.axes)
    imu = replace(imu, remarks=remarks)
    return SimulatedImu(imu=imu, axes=made) if components else imu


def simulate_signal(
    model: ModelLike,
    *,
    rate: float,
    rng: int | np.random.Generator,
    duration: float | None = None,
    samples: int | None = None,
    unit: str = "",
    resolution: float | None = None,
) -> SimulatedSignal:
    """One path of one model, with each latent process that it is the sum of: X_t = Σ_k X_t^(k).

    Parameters
    ----------
    model : Model, Process or str
        Complete, with variances in the square of `unit` per sample.
    rate : float
        Samples per second (Hz); 1 where time is counted in samples.
    rng : int or numpy.random.Generator
        Source of the draws; the path is that of `model.simulate(n, rate, rng)`.
    duration : float, optional
        Length (s); give this or `samples`.
    samples : int, optional
        Length (samples), at least 8.
    unit : str
        Unit of the signal; none by default.
    resolution : float, optional
        The signal is rounded to multiples of it, in its unit; its latent processes are not.

    Returns
    -------
    SimulatedSignal
        With `signal`, `components` by term, and `plot()`.

    Raises
    ------
    OptionError
        If an argument cannot be used.
    ModelError
        If the model has a parameter without a value, or a process that cannot be simulated.

    Examples
    --------
    >>> text = "GM(beta=0.05, sigma2=1.0) + WN(sigma2=4.0) + RW(gamma2=0.001)"
    >>> simulated = simulate_signal(text, rate=1.0, samples=1000, rng=1)
    >>> simulated
    SimulatedSignal(Signal(unnamed, 1000 samples at 1 Hz, no unit) = GM + WN + RW)
    >>> bool(np.all(sum(simulated[term].values for term in simulated) == simulated.signal.values))
    True
    """
    truth, rate = as_model(model), as_rate(rate)
    n = _length(rate, duration, samples)
    step = None if resolution is None else _step("the signal", resolution)
    _require_values("", truth)
    return _simulated(truth, n, rate, as_rng(rng), unit=unit, step=step)


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


def _require_values(axis: str, model: Model) -> None:
    open_ends = [name for name, value in model.parameters.items() if value is None]
    if open_ends:
        process = next(process for process in model.processes if not process.is_complete)
        values = (f"{name}={'…' if value is None else f'{value:g}'}" for name, value in process.values.items())
        raise ModelError(
            f"{axis and f'{axis}: '}a simulation needs every value of its model, {model} has none for "
            f'{", ".join(open_ends)}; write them in it, as "{process.name}({", ".join(values)})"'
        )


@contextmanager
def _named(axis: str) -> Iterator[None]:
    """Say of which axis an error speaks."""
    try:
        yield
    except GmwmError as error:
        raise type(error)(f"{axis}: {error}") from None


def _simulated(
    model: Model,
    n: int,
    rate: float,
    rng: np.random.Generator,
    *,
    unit: str,
    axis: str = "",
    offset: float = 0.0,
    step: float | None,
) -> SimulatedSignal:
    """A path with its latent processes, in the order in which `Model.simulate` adds them."""
    drawn = model.simulate_terms(n, rate, rng)
    total = np.zeros(n)
    parts = {}
    for term in model.drawing_order():
        total += drawn[term]
        parts[term] = Signal(drawn[term], rate, unit, f"{axis} {term}".strip())
    signal = Signal(_finished(total, offset, step), rate, unit, axis)
    return SimulatedSignal(signal=signal, components=parts, model=model, offset=offset, resolution=step)


def _finished(path: Vector, offset: float, step: float | None) -> Vector:
    if offset:
        path += offset
    return path if step is None else _rounded(path, step)


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
