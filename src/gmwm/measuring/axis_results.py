"""Results of one kind for the axes of a recording, and chi-square limits of a variance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, fields
from functools import wraps
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar, cast, overload

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import FrozenMappings, Vector, as_rate
from gmwm.base.errors import DataError
from gmwm.base.results import Plotted
from gmwm.base.text import Summarised
from gmwm.base.threads import in_threads
from gmwm.recording.chunks import MINIMUM_SAMPLES
from gmwm.recording.options import as_confidence
from gmwm.recording.signals import Imu, Signal

T = TypeVar("T")
Options = ParamSpec("Options")
Single = TypeVar("Single", covariant=True)
Several = TypeVar("Several", covariant=True)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class AxisResults(FrozenMappings, Summarised, Plotted, Mapping[str, T]):
    """Mapping of axis to result. A subclass has one field, the mapping, and `noun` for one of its results."""

    noun = "result"

    def __post_init__(self) -> None:
        if not self._results:
            raise DataError(argument=self._field, expected=f"the {self.noun} of at least one axis", got=self._results)
        super().__post_init__()

    def __getitem__(self, axis: str) -> T:
        try:
            return self._results[axis]
        except KeyError:
            raise DataError(argument="axis", expected=f"one of {', '.join(self)}", got=axis) from None

    def __iter__(self) -> Iterator[str]:
        return iter(self._results)

    def __len__(self) -> int:
        return len(self._results)

    def __contains__(self, axis: object) -> bool:
        return axis in self._results

    def get(self, axis: str, default: Any = None) -> Any:
        """Return the result of an axis, or `default` if there is none."""
        return self._results.get(axis, default)

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of each axis as plain numbers, lists and strings, by axis."""
        results: Mapping[str, Any] = self._results
        return {axis: result.to_dict() for axis, result in results.items()}

    @property
    def _field(self) -> str:
        return fields(self)[0].name

    @property
    def _results(self) -> Mapping[str, T]:
        results: Mapping[str, T] = getattr(self, self._field)
        return results


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ResultsByAxis(AxisResults[T]):
    """Results of one function by axis of a recording, or by column of an array."""

    results: Mapping[str, T]

    def summary(self) -> str:
        """Join the summaries of the axes."""
        results: Mapping[str, Any] = self.results
        return "\n\n".join(f"{axis}\n{result.summary()}" for axis, result in results.items())

    def __repr__(self) -> str:
        return "\n".join(f"{axis}: {result!r}" for axis, result in self.results.items())


def as_recording(data: Any) -> Any:
    """Return a data frame (pandas, Polars, Arrow) or a table of xarray as an Imu, and anything else unchanged.

    >>> import polars
    >>> as_recording(polars.DataFrame({"time": np.arange(8) / 50, "gyro_x [deg/s]": np.arange(8.0)}))
    Imu(gyro_x: 8 samples at 50 Hz, 0.16 s)
    """
    names = ("columns", "column_names", "collect_schema", "data_vars")
    framed = any(hasattr(type(data), name) for name in names)
    tabular = framed or (hasattr(type(data), "coords") and getattr(data, "ndim", 0) == 2)
    return Imu.from_arrays(data) if tabular else data


def signals_of(x: Any) -> dict[str, Any] | None:
    """Return the axes of an Imu, a data frame or a mapping of names, or the columns of an (N, k) array; otherwise None.

    >>> list(signals_of(np.zeros((100, 2)))), signals_of(np.zeros(100))
    (['column_0', 'column_1'], None)
    """
    x = as_recording(x)
    if isinstance(x, Imu):
        return dict(x.signals)
    if isinstance(x, Mapping) and x and all(isinstance(name, str) for name in x):
        return dict(x)
    if isinstance(x, np.ndarray) and x.ndim == 2 and x.shape[0] >= MINIMUM_SAMPLES and x.shape[0] > x.shape[1] > 1:
        return {f"column_{k}": x[:, k] for k in range(x.shape[1])}
    return None


class ByAxis(Protocol[Options, Single, Several]):
    """Function of a signal that also takes a recording, and then returns the results of all axes or columns."""

    @overload
    def __call__(self, x: Signal | ArrayLike, /, *args: Options.args, **options: Options.kwargs) -> Single: ...
    @overload
    def __call__(self, x: Imu, /, *args: Options.args, **options: Options.kwargs) -> Several: ...


def by_axis(
    collect: Callable[[dict[str, Any]], Several], *, threaded: bool = False
) -> Callable[[Callable[Concatenate[Any, Options], Single]], ByAxis[Options, Single, Several]]:
    """Let a function of a signal take a recording too; `collect` makes one result of those of the axes."""

    def extend(function: Callable[Concatenate[Any, Options], Single]) -> ByAxis[Options, Single, Several]:
        @wraps(function)
        def of_axes(x: Any, *args: Options.args, **options: Options.kwargs) -> Single | Several:
            if (signals := signals_of(x)) is None:
                return function(x, *args, **options)
            if threaded:
                return collect(in_threads(lambda _, signal: function(signal, *args, **options), signals))
            return collect({axis: function(signal, *args, **options) for axis, signal in signals.items()})

        return cast(ByAxis[Options, Single, Several], of_axes)

    return extend


def rate_of_array(rate: float | None) -> float:
    """Return the rate of a bare array: 1 if there is none, so that time is counted in samples."""
    return 1.0 if rate is None else as_rate(rate)


def rate_words(rate: float, unit: str) -> str:
    """Describe the rate of a result. Without a unit, a rate of 1 usually means that time is counted in samples.

    >>> rate_words(100.0, "rad/s"), rate_words(1.0, "")
    ('at 100 Hz', 'with rate=1, so times count samples')
    """
    return f"at {rate:g} Hz" if unit or rate != 1 else "with rate=1, so times count samples"


def chi_square_limits(variance: Vector, freedom: Vector, confidence: float) -> tuple[Vector, Vector]:
    """Return the chi-square limits η V / q_{(1 ± c)/2} of variances V with η degrees of freedom (Percival 1995)."""
    from scipy.special import gammaincinv

    half = freedom / 2
    tail = (1 - as_confidence(confidence)) / 2
    return variance * half / gammaincinv(half, 1 - tail), variance * half / gammaincinv(half, tail)
