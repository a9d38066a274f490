"""Simulate static recordings and single signals from noise models, with their latent processes."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Literal, TypeVar, overload

import numpy as np

from gmwm.base.arrays import FrozenMappings, Vector, as_rate, as_whole_number
from gmwm.base.errors import DataError, GmwmError, ModelError, OptionError
from gmwm.base.remarks import Remark
from gmwm.base.results import Plotted
from gmwm.base.units import AXES, SI_UNIT, STANDARD_GRAVITY, axis_quantity, si_unit
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.signals import Imu, Signal
from gmwm.recording.writers import write_table
from gmwm.theory.processes.base import Process
from gmwm.theory.processes.markov import GM
from gmwm.theory.processes.model import Model, ModelLike, as_model
from gmwm.theory.processes.noise import QN, RW, WN
from gmwm.theory.processes.validation import as_rng, as_seed


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedSignal(FrozenMappings, Plotted):
    """Simulated signal X_t = offset + Σ_k X_t^(k), with the latent process X^(k) of each term k of the model.

    Parameters
    ----------
    signal : Signal
        The signal X.
    components : mapping of term to Signal
        The latent processes by the names of `model.terms`, in the order in which they were added. If `resolution` is
        None, `offset + sum(path.values for path in components.values())` equals `signal.values` to the last bit.
    model : Model
        The model with its values.
    offset : float
        Gravity or 0, in the unit of the signal; it was added to the noise.
    resolution : float or None
        The step of the rounded signal, in the unit of the signal; None if it is not rounded. The latent processes are
        not rounded, so their sum agrees with the signal within half a step.
    """

    signal: Signal
    components: Mapping[str, Signal]
    model: Model
    offset: float = 0.0
    resolution: float | None = None

    def __getitem__(self, term: str) -> Signal:
        try:
            return self.components[term]
        except KeyError:
            raise DataError(argument="term", expected=f"one of {', '.join(self.model.terms)}", got=term) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.components)

    def __repr__(self) -> str:
        return f"SimulatedSignal({self.signal!r} = {' + '.join(self.model.terms)})"

    def write_components(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write the latent processes as a table with one column each.

        The columns are `time [s]` and one for each term, such as `gyro_x WN [rad/s]`, with full precision.
        `gmwm.read(path, columns={"gyro_x": "gyro_x WN [rad/s]"})` reads one of them. If writing fails, no file
        remains.

        Parameters
        ----------
        path : path
            File to write, ending in .csv or .parquet.

        Returns
        -------
        tuple of str
            Names of the columns after the time.

        Raises
        ------
        OptionError
            If the path has another ending.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> from gmwm import simulate_signal
        >>> folder = tempfile.TemporaryDirectory()
        >>> simulated = simulate_signal("WN(sigma2=1) + RW(gamma2=0.01)", rate=10.0, samples=100, rng=1, unit="m")
        >>> simulated.write_components(pathlib.Path(folder.name, "parts.csv"))
        ('RW [m]', 'WN [m]')
        >>> folder.cleanup()
        """
        return _write_components([self], path)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class SimulatedImu(FrozenMappings):
    """A simulated recording with the latent processes of each axis.

    Parameters
    ----------
    imu : Imu
        The recording.
    axes : mapping of axis to SimulatedSignal
        Each axis with its latent processes; `simulated["gyro_x"]` is the same as `simulated.axes["gyro_x"]`.
    """

    imu: Imu
    axes: Mapping[str, SimulatedSignal]

    @property
    def components(self) -> dict[str, Mapping[str, Signal]]:
        """The latent processes by axis and term: `components["gyro_x"]["WN"]`."""
        return {axis: simulated.components for axis, simulated in self.axes.items()}

    def __getitem__(self, axis: str) -> SimulatedSignal:
        try:
            return self.axes[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self.axes)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self.axes)

    def __repr__(self) -> str:
        parts = "; ".join(f"{axis} = {' + '.join(signal.model.terms)}" for axis, signal in self.axes.items())
        return f"SimulatedImu({self.imu!r}; {parts})"

    def write_components(self, path: str | os.PathLike[str]) -> tuple[str, ...]:
        """Write the latent processes of all axes to the file `path`; see `SimulatedSignal.write_components`."""
        return _write_components(list(self.axes.values()), path)


def _write_components(parts: Sequence[SimulatedSignal], path: str | os.PathLike[str]) -> tuple[str, ...]:
    """Write the latent processes of several signals as one table. Return the names of the columns after the time."""
    columns = {}
    for part in parts:
        for component in part.components.values():
            unit = f" [{component.unit}]" if component.unit else ""
            columns[f"{component.axis}{unit}"] = component.values
    write_table({"time [s]": parts[0].signal.times(), **columns}, path)
    return tuple(columns)


T = TypeVar("T")

_PLACES = (*SI_UNIT, *AXES)
_ACCELEROMETERS = tuple(axis for axis in AXES if axis_quantity(axis) == "accel")


@overload
def simulate(
    models: Mapping[str, ModelLike] | ModelLike, *, rate: float, rng: int | np.random.Generator,
    duration: float | None = None, samples: int | None = None, resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z", components: Literal[False] = False,
) -> Imu: ...  # fmt: skip
@overload
def simulate(
    models: Mapping[str, ModelLike] | ModelLike, *, rate: float, rng: int | np.random.Generator,
    duration: float | None = None, samples: int | None = None, resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z", components: Literal[True],
) -> SimulatedImu: ...  # fmt: skip
def simulate(
    models: Mapping[str, ModelLike] | ModelLike, *, rate: float, rng: int | np.random.Generator,
    duration: float | None = None, samples: int | None = None, resolution: Mapping[str, float] | None = None,
    gravity: str | None = "accel_z", components: bool = False,
) -> Imu | SimulatedImu:  # fmt: skip
    """Simulate a static recording with known noise, from a noise model for each axis.

    The noise of an axis is X_t = Σ_k X_t^(k), where X^(k) is the process of term k of its model. Each axis has its own
    stream of random numbers, so the noise of gyro_y does not depend on which other axes are simulated.

    Parameters
    ----------
    models : mapping of axis to model, or one model
        Models with a value for every parameter, as objects or as text; variances in (rad/s)² or (m/s²)² per sample.
        The keys are axes, or "gyro" and "accel" for all three axes of a sensor; the model of an axis replaces the model
        of its sensor. A single model applies to all six axes.
    rate : float
        Sampling rate (Hz).
    rng : int or numpy.random.Generator
        Seed; the same integer gives the same recording. If a Generator is given, the seed is drawn from it. The remarks
        of the recording state the seed.
    duration : float, optional
        Length (s); give this or `samples`.
    samples : int, optional
        Length (samples), at least 8.
    resolution : mapping, optional
        Least significant bit of the output (rad/s or m/s²) by axis or sensor. Each sample is rounded to a multiple of
        it, which adds white noise of variance resolution²/12. By default no axis is rounded.
    gravity : axis or None
        The accelerometer to which 9.80665 m/s² is added, if it is simulated; None adds no gravity.
    components : bool
        Whether to return the latent process of each term as well. The recording does not depend on this option.

    Returns
    -------
    Imu, or SimulatedImu with `components=True`
        The recording in SI units; its remarks state the model of each axis and the seed. A `SimulatedImu` holds the
        recording as `imu`, and the latent processes as `components["gyro_x"]["WN"]`.

    Raises
    ------
    OptionError
        If an argument has a value that is not allowed, or if the recording has fewer than 8 samples.
    ModelError
        If a model has a parameter without a value, or a process that cannot be simulated.

    Examples
    --------
    >>> imu = simulate({"gyro_x": "WN(sigma2=4e-8) + RW(gamma2=1e-14)"}, rate=100.0, duration=10.0, rng=1)
    >>> imu
    Imu(gyro_x: 1000 samples at 100 Hz, 10 s)
    >>> imu.remarks[0].facts
    {'case': 'simulated', 'model': 'WN(sigma2=4e-08) + RW(gamma2=1e-14)', 'seed': 1}
    >>> simulated = simulate({"gyro": "WN(sigma2=4e-8)"}, rate=100.0, duration=10.0, rng=1, components=True)
    >>> simulated["gyro_x"]["WN"]
    Signal(gyro_x WN, 1000 samples at 100 Hz, rad/s)
    """
    rate, seed = as_rate(rate), as_seed(rng)
    n = _length(rate, duration, samples)
    truth = models_by_axis(models)
    steps = {axis: _step(value, axis) for axis, value in _by_axis(resolution or {}, "resolution").items()}
    if gravity is not None and gravity not in _ACCELEROMETERS:
        raise OptionError(argument="gravity", expected=f"one of {', '.join(_ACCELEROMETERS)} or None", got=gravity)
    streams = dict(zip(AXES, np.random.SeedSequence(seed).spawn(len(AXES)), strict=True))

    arrays, signals = {}, {}
    for axis, model in truth.items():
        generator = np.random.default_rng(streams[axis])
        _require_values(axis, model)
        offset = STANDARD_GRAVITY if axis == gravity else 0.0
        with _errors_about(axis):
            if components:
                unit = si_unit(axis)
                signals[axis] = _simulate(
                    model, n, rate, generator, unit=unit, axis=axis, offset=offset, step=steps.get(axis)
                )
                arrays[axis] = signals[axis].signal.values
            else:
                arrays[axis] = _finish(model.simulate(n, rate, generator), offset, steps.get(axis))
    imu = Imu.from_arrays(arrays, rate, source=f"simulation with seed {seed}")
    remarks = tuple(
        Remark.of("file-content", axis, case="simulated", model=str(truth[axis]), seed=seed) for axis in imu.axes
    )
    imu = replace(imu, remarks=remarks)
    return SimulatedImu(imu=imu, axes=signals) if components else imu


def simulate_signal(
    model: ModelLike, *, rate: float, rng: int | np.random.Generator, duration: float | None = None,
    samples: int | None = None, unit: str = "", resolution: float | None = None,
) -> SimulatedSignal:  # fmt: skip
    """Simulate one signal from a model, and return it with the latent process of each term.

    The signal is X_t = Σ_k X_t^(k), where X^(k) is the latent process of term k of the model.

    Parameters
    ----------
    model : Model, Process or str
        A model with a value for every parameter; variances in the square of `unit` per sample.
    rate : float
        Sampling rate (Hz); 1 to count time in samples.
    rng : int or numpy.random.Generator
        Seed or generator; the signal is the same as from `model.simulate(n, rate, rng)`.
    duration : float, optional
        Length (s); give this or `samples`.
    samples : int, optional
        Length (samples), at least 8.
    unit : str
        Unit of the signal; none by default.
    resolution : float, optional
        Step, in the unit of the signal, to whose multiples the signal is rounded. The latent processes are not rounded.

    Returns
    -------
    SimulatedSignal
        The simulated `signal`, its `components` by term, and `plot()`.

    Raises
    ------
    OptionError
        If an argument has a value that is not allowed, or if the signal has fewer than 8 samples.
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
    step = None if resolution is None else _step(resolution)
    _require_values("", truth)
    return _simulate(truth, n, rate, as_rng(rng), unit=unit, step=step)


def models_by_axis(models: Mapping[str, ModelLike] | ModelLike) -> dict[str, Model]:
    """Return the model of each axis from `models` of `simulate`; OptionError if empty or of another kind."""
    if isinstance(models, str | Process | Model):
        return dict.fromkeys(AXES, as_model(models))
    if not isinstance(models, Mapping) or not models:
        raise OptionError(
            argument="models",
            expected="a model, or a mapping of axes to models such as {'gyro': 'WN(sigma2=4e-8)'}",
            got=models,
        )
    return {axis: as_model(model) for axis, model in _by_axis(models, "models").items()}


def _by_axis(given: Mapping[str, T], name: str) -> dict[str, T]:
    """Return one value for each axis that is a key, or whose sensor is a key."""
    unknown = [key for key in given if key not in _PLACES]
    if unknown:
        raise OptionError(argument=name, expected=f"a mapping with keys among {', '.join(_PLACES)}", got=unknown[0])
    of = {axis: axis if axis in given else axis[:-2] for axis in AXES}
    return {axis: given[key] for axis, key in of.items() if key in given}


def _length(rate: float, duration: float | None, samples: int | None) -> int:
    """Return the number of samples from the length in seconds or in samples."""
    if (duration is None) == (samples is None):
        what = "no length is given" if duration is None else "two lengths are given, a duration and a number of samples"
        raise OptionError(
            what, argument="duration", got=duration, advice="Pass either {--duration} (s) or {--samples}."
        )
    if duration is not None:
        if not (math.isfinite(duration) and duration > 0):
            raise OptionError(argument="duration", expected="a positive, finite number (s)", got=duration)
        n = round(duration * rate)
        if n < MINIMUM_SAMPLES:
            raise OptionError(
                f"{duration:g} s at {rate:g} Hz are {n} samples, but at least {MINIMUM_SAMPLES} are needed",
                argument="duration", got=duration, advice="Pass a longer {--duration}.",
            )  # fmt: skip
        return n
    assert samples is not None
    expected = f"an integer, at least {MINIMUM_SAMPLES}"
    return as_whole_number(samples, "samples", MINIMUM_SAMPLES, expected=expected)


def _require_values(axis: str, model: Model) -> None:
    missing = [name for name, value in model.parameters.items() if value is None]
    if missing:
        process = next(process for process in model.processes if not process.is_complete)
        values = (f"{name}={'…' if value is None else f'{value:g}'}" for name, value in process.values.items())
        raise ModelError(
            f"a simulation needs a value for every parameter, but {model} has none for {', '.join(missing)}",
            advice='Write the values in the model, such as "{example}".',
            example=f"{process.name}({', '.join(values)})",
        ).about(axis)


@contextmanager
def _errors_about(axis: str) -> Iterator[None]:
    """Add the axis to errors that are raised in the block."""
    try:
        yield
    except GmwmError as error:
        error.about(axis)
        raise


def _simulate(
    model: Model, n: int, rate: float, rng: np.random.Generator, *, unit: str, axis: str = "", offset: float = 0.0,
    step: float | None,
) -> SimulatedSignal:  # fmt: skip
    """Simulate a signal and its latent processes, and add these in the same order as `Model.simulate`."""
    drawn = model.simulate_terms(n, rate, rng)
    total = np.zeros(n)
    parts = {}
    for term in model.drawing_order():
        total += drawn[term]
        parts[term] = Signal(drawn[term], rate, unit, f"{axis} {term}".strip())
    signal = Signal(_finish(total, offset, step), rate, unit, axis)
    return SimulatedSignal(signal=signal, components=parts, model=model, offset=offset, resolution=step)


def _finish(path: Vector, offset: float, step: float | None) -> Vector:
    """Add an offset to a path, in place, and round the result."""
    if offset:
        path += offset
    return path if step is None else _quantise(path, step)


def _step(step: float, axis: str = "") -> float:
    if not (math.isfinite(step) and step > 0):
        raise OptionError(
            argument="resolution", expected="a positive, finite number in the unit of the signal", got=step
        ).about(axis)
    return float(step)


def _quantise(path: Vector, step: float) -> Vector:
    """Round to the nearest multiple of `step`."""
    inverse = round(1 / step)
    # Division by an integer gives the double nearest to a decimal such as 0.0123, which is short in a text file.
    if inverse and math.isclose(inverse * step, 1, rel_tol=1e-12):
        return np.asarray(np.rint(path * inverse) / inverse)
    return np.asarray(np.rint(path / step) * step)


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
