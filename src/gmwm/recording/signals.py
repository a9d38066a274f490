"""Recordings in memory: a Signal is one axis, an Imu is a set of axes with one time base. Both are immutable."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import pairwise
from operator import ge
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import ArrayLike

from gmwm.base.arrays import FrozenMappings, Vector, as_rate, as_vector, freeze, runs_of
from gmwm.base.errors import DataError, OptionError
from gmwm.base.remarks import Remark
from gmwm.base.results import Plotted, Tabular
from gmwm.base.text import counted
from gmwm.base.time_base import TimeBase, begins_of, times_of
from gmwm.base.units import AXES, SI_UNIT, Quantity, axis_quantity, parse_unit, require_measurable, si_unit
from gmwm.recording.chunks import samples_of, time_base_of, with_samples
from gmwm.recording.time_ranges import cut, kept_ranges

if TYPE_CHECKING:
    from polars import DataFrame

__all__ = ["Imu", "Signal"]


@dataclass(frozen=True, eq=False)
class Signal(Plotted):
    """One axis of a static recording.

    Parameters
    ----------
    values : (N,) array, in `unit`
        The samples in order. The array becomes read-only.
    rate : float
        Samples per second (Hz).
    unit : str
        Unit of the values; "rad/s" or "m/s²" in recordings from `gmwm.read`.
    axis : str
        Name of the axis, such as "gyro_x".
    start : float
        Time of the first sample (s) on the clock of the recording.
    segments : tuple of (start, stop)
        Index ranges that are uniformly sampled. Samples are missing between one range and the next.
    starts : tuple of float
        Time of the first sample of each segment (s). By default one sample is missing in each gap.
    filled : int
        Number of values that replace lost samples; see `fill_gaps`.
    gaps_known : bool
        Whether the lengths of the gaps are known (by default, if `starts` is given). Other gaps are not filled.

    Raises
    ------
    DataError
        If a value is not finite or above 1e12 rad/s or m/s², or the segments or starts do not fit the values.
    OptionError
        If the rate is not a positive number.
    """

    values: Vector
    rate: float
    unit: str = ""
    axis: str = ""
    start: float = 0.0
    segments: tuple[tuple[int, int], ...] = ()
    starts: tuple[float, ...] = ()
    filled: int = 0
    gaps_known: bool = True

    def __init__(
        self, values: ArrayLike, rate: float, unit: str = "", axis: str = "", start: float = 0.0,
        segments: Sequence[tuple[int, int]] = (), starts: Sequence[float] = (), filled: int = 0,
        gaps_known: bool | None = None,
    ) -> None:  # fmt: skip
        vector = as_vector(values, axis or "the signal", at_least=1)
        require_measurable(vector, unit, axis)
        if vector.flags.writeable:
            vector = freeze(vector.view())
        firsts, ends = (tuple(map(int, part)) for part in zip(*(tuple(segments) or ((0, vector.size),)), strict=True))
        ranges = tuple(zip(firsts, ends, strict=True))
        if firsts[0] != 0 or ends[-1] != vector.size or any(map(ge, firsts, ends)):
            expected = f"non-empty ranges that cover all {vector.size} samples"
            raise DataError(argument="segments", expected=expected, got=segments)
        if firsts[1:] != ends[:-1]:
            raise DataError(argument="segments", expected="consecutive ranges without overlap", got=segments)
        rate = as_rate(rate)
        times = tuple(map(float, starts)) or tuple(start + (a + k) / rate for k, (a, _) in enumerate(ranges))
        if len(times) != len(ranges):
            expected = f"a sequence with one time for each of {len(ranges)} segments"
            raise DataError(argument="starts", expected=expected, got=tuple(starts))
        for name, value in (
            ("values", vector), ("rate", rate), ("unit", unit), ("axis", axis),
            ("start", times[0]), ("segments", ranges), ("starts", times), ("filled", int(filled)),
            ("gaps_known", len(starts) > 0 if gaps_known is None else gaps_known),
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    @classmethod
    def from_missing(cls, values: ArrayLike, rate: float, unit: str = "", axis: str = "", start: float = 0.0) -> Signal:
        """Make a signal with gaps from an array in which missing samples are NaN or masked.

        Parameters
        ----------
        values : (N,) array, in `unit`
            The samples at equal intervals, NaN or masked where one is missing.
        rate, unit, axis
            As for `Signal`.
        start : float
            Time of the first value (s), whether it is missing or not.

        Raises
        ------
        DataError
            If all samples are missing, a value is infinite, or the array cannot be used.
        OptionError
            If the rate is not a positive number.

        Examples
        --------
        >>> signal = Signal.from_missing([1.0, 2.0, float("nan"), float("nan"), 5.0], rate=10.0)
        >>> signal.segments, signal.starts
        (((0, 2), (2, 3)), (0.0, 0.4))
        """
        if isinstance(values, np.ma.MaskedArray):
            values = np.ma.filled(values.astype(np.float64), np.nan)
        vector, rate = as_vector(values, axis or "the signal", finite=False), as_rate(rate)
        present = ~np.isnan(vector)
        infinite = int(np.count_nonzero(np.isinf(vector)))
        if infinite:
            what = f"{axis or 'the signal'} has {counted(infinite, 'infinite value')}"
            raise DataError(
                f"{what}, the first at index {int(np.argmax(np.isinf(vector)))}",
                advice="If infinite values mark missing samples, replace them with NaN.",
            )
        if not present.any():
            raise DataError(
                f"all {vector.size} samples of {axis or 'the signal'} are missing", argument="values", got=vector,
                advice="Check the column that the signal was read from.",
            )  # fmt: skip
        edges = runs_of(present)
        ends = np.cumsum([0, *(edges[:, 1] - edges[:, 0])]).tolist()
        starts = (start + edges[:, 0] / rate).tolist()
        return cls(vector[present], rate, unit, axis, segments=list(pairwise(ends)), starts=starts)

    def __reduce__(self) -> tuple[Any, ...]:
        return Signal, tuple(getattr(self, field.name) for field in fields(self))  # a copy is read-only as well

    def __len__(self) -> int:
        return int(self.values.size)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
        return np.array(self.values, dtype=dtype, copy=copy)

    def __getitem__(self, samples: slice) -> Signal:
        """Return a range of consecutive samples, as in `signal[:1000]`.

        >>> Signal([1.0, 2.0, 3.0], 10.0, segments=((0, 2), (2, 3)), starts=(0.0, 5.0))[1:].starts
        (0.1, 5.0)
        """
        first, last, step = samples.indices(len(self)) if isinstance(samples, slice) else (0, 0, 0)
        if step != 1 or first >= last:
            raise DataError(
                argument="samples", expected="a range of at least one sample without a step, such as signal[:1000]",
                got=samples, advice="Use `signal.values` for single samples.",
            )  # fmt: skip
        pieces = [(max(a, first), min(b, last), a, t) for (a, b), t in zip(self.segments, self.starts, strict=True)]
        pieces = [piece for piece in pieces if piece[0] < piece[1]]
        return replace(
            self, values=self.values[first:last], segments=tuple((a - first, b - first) for a, b, _, _ in pieces),
            starts=tuple(t + (a - begin) / self.rate for a, _, begin, t in pieces),
            start=pieces[0][3] + (pieces[0][0] - pieces[0][2]) / self.rate,
        )  # fmt: skip

    def __repr__(self) -> str:
        gaps = f", {len(self.segments)} segments" if len(self.segments) > 1 else ""
        what = f"{len(self)} samples at {self.rate:g} Hz, {self.unit or 'no unit'}"
        return f"Signal({self.axis or 'unnamed'}, {what}{gaps})"

    @property
    def duration(self) -> float:
        """Recorded time without the gaps (s)."""
        return len(self) / self.rate

    def times(self, indices: ArrayLike | None = None) -> Vector:
        """Return the times of samples (s), which are uniform within each segment.

        Parameters
        ----------
        indices : array of int, optional
            Indices of the samples; all by default.

        >>> Signal([1.0, 2.0, 3.0], 10.0, segments=((0, 2), (2, 3)), starts=(0.0, 5.0)).times()
        array([0. , 0.1, 5. ])
        """
        return times_of(np.arange(len(self)) if indices is None else indices, self.rate, self.segments, self.starts)

    def whole(self) -> Vector:
        """Return the values, if the signal has no gaps.

        Raises
        ------
        DataError
            If the signal has gaps.
        """
        if len(self.segments) > 1:
            sizes = ", ".join(str(b - a) for a, b in self.segments[:5])
            raise DataError(
                f"{self.axis or 'the signal'} has gaps: {len(self.segments)} segments of {sizes}"
                f"{', …' if len(self.segments) > 5 else ''} samples",
                advice="To use only the longest segment, pass {--gaps=longest}.",
            )
        return self.values

    def segment_values(self) -> list[Vector]:
        """Return the values of each segment, one array each.

        >>> Signal([1.0, 2.0, 3.0], 10.0, segments=((0, 2), (2, 3))).segment_values()
        [array([1., 2.]), array([3.])]
        """
        return [self.values[first:last] for first, last in self.segments]

    def write(self, path: str | os.PathLike[str], *, format: str | None = None) -> None:
        """Write the signal as a recording of one axis to the file `path` in a `format`; see `Imu.write`."""
        from gmwm.recording.writers import write

        write(self, path, format=format)

    def fill_gaps(self) -> Signal:
        """Fill gaps with draws from the conditional distribution of the lost samples given the known samples.

        The distribution is estimated from the signal, with fixed seeds. The wavelet variance of the result is unbiased
        at every level. A gap of g ≤ 8192 samples is filled if 3/4 of the max(32 g, 1024) samples on each side are known
        (fewer at an end of the recording). At least 2 g samples on each side must be known, or 16 g for a gap of more
        than 64 samples. Other gaps are kept, and all gaps of unknown length. A gap is also kept if the means before and
        after it differ by more than 6 standard deviations of such differences at other places, because the sensor has
        then restarted with another offset.

        >>> x = np.random.default_rng(1).normal(size=4000)
        >>> x[100:110] = x[2500] = np.nan
        >>> signal = Signal.from_missing(x, rate=100.0)
        >>> len(signal.segments), len(signal.fill_gaps().segments), signal.fill_gaps().filled
        (3, 1, 11)
        """
        from gmwm.recording.gaps import fill_gaps

        return fill_gaps({self.axis: self})[self.axis]

    def longest(self) -> Signal:
        """Return the longest segment as a signal without gaps."""
        return replace(self[slice(*max(self.segments, key=lambda segment: segment[1] - segment[0]))], filled=0)


def changed(signal: Signal, **valid: Any) -> Signal:
    """Return a signal with other fields that need no check, which is a pass over all samples and all segments."""
    new = object.__new__(Signal)
    new.__dict__.update(signal.__dict__, **valid)
    return new


@dataclass(frozen=True, eq=False)
class Imu(FrozenMappings, Plotted, Tabular):
    """A recording of several axes with one time base.

    Parameters
    ----------
    signals : mapping of axis name to Signal
        The axes; they have the same length, rate and segments. An array becomes a Signal in rad/s or m/s² with rate=1,
        so that times count samples; `from_arrays` takes a rate.
    source : str
        File or other origin, for titles and reports.
    remarks : tuple of Remark
        Remarks on how the file was interpreted: units, rate, columns, time stamps, and times that were left out.
    time_base : TimeBase or None
        Properties of the time stamps.
    temperature : (N,) array or None
        Temperature (°C), if the file has a column for it.

    Raises
    ------
    DataError
        If there is no axis, or the axes or the temperature do not fit each other.

    Examples
    --------
    >>> axes = {"gyro_x": [0.0, 0.1], "gyro_y": [0.0, 0.2], "accel_z": [9.8, 9.8]}
    >>> imu = Imu.from_arrays(axes, rate=100)
    >>> imu["gyro_x"]
    Signal(gyro_x, 2 samples at 100 Hz, rad/s)
    >>> imu["gyro"]
    Imu(gyro_x, gyro_y: 2 samples at 100 Hz, 0.02 s)
    """

    signals: Mapping[str, Signal]
    source: str = ""
    remarks: tuple[Remark, ...] = ()
    time_base: TimeBase | None = None
    temperature: Vector | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        if not isinstance(self.signals, Mapping):
            raise DataError(
                argument="signals", expected="a mapping of axis name to Signal", got=self.signals,
                advice="Make an Imu from arrays by `gmwm.Imu.from_arrays(arrays, rate)`.",
            )  # fmt: skip
        if not self.signals:
            raise DataError(argument="signals", expected="a mapping of at least one axis", got={})
        if not all(isinstance(signal, Signal) for signal in self.signals.values()):
            object.__setattr__(self, "signals", {axis: _as_signal(x, axis) for axis, x in self.signals.items()})
        first = next(iter(self.signals.values()))
        for name, signal in self.signals.items():
            if len(signal) != len(first) or signal.rate != first.rate or signal.segments != first.segments:
                difference = f"{name} is {signal!r}, {first.axis or 'the first'} is {first!r}"
                raise DataError(
                    f"all axes of an Imu must have the same length, rate and segments, but {difference}",
                    argument="signals", got=self.signals,
                )  # fmt: skip
        if self.temperature is not None and len(self.temperature) != len(first):
            raise DataError(
                f"temperature has {len(self.temperature)} values for {len(first)} samples",
                argument="temperature", got=self.temperature,
            )  # fmt: skip
        order = {axis: k for k, axis in enumerate(AXES)}
        ordered = dict(sorted(self.signals.items(), key=lambda item: order.get(item[0], len(AXES))))
        object.__setattr__(self, "signals", MappingProxyType(ordered))

    @classmethod
    def from_arrays(
        cls, arrays: Any, rate: float | None = None, *, units: Mapping[str, str] | None = None,
        axes: Sequence[str] = AXES, start: float = 0.0, segments: Sequence[tuple[int, int]] = (), source: str = "",
    ) -> Imu:  # fmt: skip
        """Make an Imu from arrays or a table in memory.

        Parameters
        ----------
        arrays : mapping of axis name to (N,) array, (N, len(axes)) array, or table
            The samples. The columns of a two-dimensional array are `axes` in their order. A table is a data frame of
            pandas or Polars, an Arrow table, an xarray Dataset or DataArray, an array of records, or a mapping with
            "time" or missing values. Its columns are recognised by their names as in a file. Its time is a column, or
            the index of pandas or xarray.
        rate : float, optional
            Samples per second (Hz). It is required unless a table has a time.
        units : mapping, optional
            Units of the arrays, such as {"gyro": "deg/s", "accel": "g"}; by default the units that the column names of
            a table state, and otherwise rad/s and m/s².
        axes : sequence of str
            Names of the columns of a two-dimensional array.
        start, segments
            As for `Signal`. For a table, they are determined from its time and its missing values.
        source : str
            Name for titles and reports.

        Raises
        ------
        ReadError, DataError, OptionError, UnitError
            If the arrays cannot be used, no axis is known, or a unit is unknown. Warnings are the same as from
            `gmwm.read`.

        >>> imu = Imu.from_arrays({"gyro_x": [0.0, 180.0]}, rate=100, units={"gyro": "deg/s"})
        >>> imu["gyro_x"].values
        array([0.        , 3.14159265])
        >>> clock = {"time": np.arange(8) / 50, "gyro_x [deg/s]": np.arange(8.0)}
        >>> Imu.from_arrays(clock)
        Imu(gyro_x: 8 samples at 50 Hz, 0.16 s)
        """
        from gmwm.files.readers.api import is_table, read_table

        if is_table(arrays) and not segments:
            return read_table(arrays, rate, units, source)
        if rate is None:
            raise OptionError(argument="rate", expected="samples per second (Hz), because there is no time", got=rate)
        columns = arrays if isinstance(arrays, Mapping) else _columns(arrays, axes)
        unknown = sorted(set(units or {}) - set(SI_UNIT))
        if unknown:
            raise OptionError(argument="units", expected="a mapping of gyro and accel to units", got=units)
        signals = {}
        for axis, values in columns.items():
            quantity = axis_quantity(axis)
            si = SI_UNIT[quantity]
            factor = parse_unit((units or {}).get(quantity, si), quantity).factor
            vector = as_vector(values, axis)
            vector = vector if factor == 1 else vector * factor
            signals[axis] = Signal(values=vector, rate=rate, unit=si, axis=axis, start=start, segments=segments)
        return cls(signals, source, time_base=TimeBase(as_rate(rate), start=start))

    @overload
    def __getitem__(self, axis: Quantity | list[str] | tuple[str, ...] | slice) -> Imu: ...  # type: ignore[overload-overlap]
    @overload
    def __getitem__(self, axis: str) -> Signal: ...
    def __getitem__(self, axis: str | list[str] | tuple[str, ...] | slice) -> Signal | Imu:
        """Return the signal of an axis, as in `imu["gyro_x"]`, or an Imu: with the axes of a sensor, as in
        `imu["gyro"]`, with some axes, as in `imu[["gyro_x", "gyro_y"]]`, or with a range of samples, `imu[:1000]`.

        >>> imu = Imu.from_arrays({"gyro_x": np.arange(9.0), "gyro_y": np.arange(9.0)}, rate=10)
        >>> imu[["gyro_y"]], imu[2:5]["gyro_x"].values
        (Imu(gyro_y: 9 samples at 10 Hz, 0.9 s), array([2., 3., 4.]))
        """
        if isinstance(axis, slice):
            part = {name: signal[axis] for name, signal in self.signals.items()}
            begin = next(iter(part.values())).start - next(iter(self.signals.values())).start
            base = self.time_base
            base = base and replace(base, start=base.start + begin, left=base.left + begin)
            temperature = None if self.temperature is None else self.temperature[axis]
            return replace(self, signals=part, time_base=base, temperature=temperature)
        if not isinstance(axis, str):
            return replace(self, signals={name: self[name] for name in axis})
        if axis in self.signals:
            return self.signals[axis]
        members = {name: signal for name, signal in self.signals.items() if name in AXES and name[:-2] == axis}
        if not members:
            sensors = dict.fromkeys(name[:-2] for name in self.axes if name in AXES)
            raise DataError(argument="axis", expected=f"one of {', '.join((*self.axes, *sensors))}", got=axis)
        return replace(self, signals=members)

    def __iter__(self) -> Iterator[str]:
        return iter(self.signals)

    def __len__(self) -> int:
        return len(next(iter(self.signals.values())))

    if not TYPE_CHECKING:  # for the overloads of other functions, a recording is not an array

        def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray[Any, Any]:
            return np.column_stack([signal.values for signal in self.signals.values()]).astype(dtype or np.float64)

    def __repr__(self) -> str:
        return f"Imu({', '.join(self.axes)}: {len(self)} samples at {self.rate:g} Hz, {self.duration:g} s)"

    @property
    def axes(self) -> tuple[str, ...]:
        """Names of the axes, gyroscopes first."""
        return tuple(self.signals)

    @property
    def rate(self) -> float:
        """Samples per second (Hz)."""
        return next(iter(self.signals.values())).rate

    @property
    def duration(self) -> float:
        """Recorded time without the gaps (s)."""
        return len(self) / self.rate

    @property
    def segments(self) -> tuple[tuple[int, int], ...]:
        """Index ranges without a gap."""
        return next(iter(self.signals.values())).segments

    def between(
        self, start: float | None = None, stop: float | None = None, skip: Sequence[tuple[float, float]] = ()
    ) -> Imu:
        """Return the part of the recording between two times, without the ranges in `skip`, each of which leaves a gap.

        Times are measured from the first sample on the recording's clock, gaps included. If the clock was set back, the
        next sample is treated as one sampling interval later. The part includes a sample at `start` and excludes one at
        `stop`.

        Parameters
        ----------
        start, stop : float, optional
            Times (s); by default the beginning and the end.
        skip : sequence of (from, to)
            Ranges to leave out (s), in any order. A range may extend beyond the end, but may not begin after it.

        Returns
        -------
        Imu
            The part, with a remark on the times that are used.

        Raises
        ------
        OptionError
            If a time is negative or not a number, or an end is not after its beginning.
        DataError
            If no segment of 8 samples or more is left, or a range to skip begins after the end.

        Warns
        -----
        GmwmWarning
            If `stop` is after the end of the recording.

        Examples
        --------
        >>> imu = Imu.from_arrays({"gyro_x": np.arange(100.0)}, rate=10.0)
        >>> imu.between(2.0, 9.0)
        Imu(gyro_x: 70 samples at 10 Hz, 7 s)
        >>> part = imu.between(2.0, skip=[(5.0, 6.0)])
        >>> part.segments, part["gyro_x"].starts
        (((0, 30), (30, 70)), (2.0, 6.0))
        """
        parts = cut(samples_of(self, self.axes), time_base_of(self), kept_ranges(start, stop, skip))
        if parts is None:
            return self
        part, base, remark = parts
        return with_samples(self, part, base, [remark])

    def write(self, path: str | os.PathLike[str], *, format: str | None = None) -> None:
        """Write the recording to a file; the suffix of the path chooses the format: .csv, .parquet, .mcap or .imu.

        In tables the columns are `time [s]`, the axes with their units as in `gyro_x [rad/s]`, and `temperature [°C]`
        if there is one. Numbers keep full precision. Times follow the uniform clock of each segment, so gaps are kept.
        If writing fails, no partial file is left.

        An .mcap file holds messages sensor_msgs/msg/Imu of ROS 2, with all three axes of a sensor and stamps in whole
        nanoseconds.

        An .imu file holds the time and the increments v/f of six axes in counts of its type. If the counts are whole
        numbers, the rounding error of a sample is carried over to the next one, as a sensor of that type does: no angle
        or velocity is lost, and the added noise is quantization noise of one count.

        Parameters
        ----------
        path : path
            File to write.
        format : str, optional
            Record type of an .imu file: "imu:IMAR", "imu:LN200", "imu:LN200IG", "imu:IXSEA", "imu:NAVCHIP_INT" or
            "imu:NAVCHIP_FLT".

        Raises
        ------
        OptionError
            If the suffix or the format is unknown.
        DataError
            If an .imu file is written and an axis is missing, or a value does not fit into the counts.

        Examples
        --------
        >>> import tempfile, pathlib
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = pathlib.Path(folder.name, "three.csv")
        >>> Imu.from_arrays({"gyro_x": [0.1, 0.2, 0.3]}, rate=100).write(path)
        >>> path.read_text().splitlines()[:2]
        ['time [s],gyro_x [rad/s]', '0.0,0.1']
        >>> folder.cleanup()
        """
        from gmwm.recording.writers import write

        write(self, path, format=format)

    def to_polars(self) -> DataFrame:
        """Return the recording as a data frame of Polars, with its time and temperature. `from_arrays` reads it."""
        import polars

        from gmwm.recording.writers import columns_of

        return polars.DataFrame(columns_of(self))

    def to_xarray(self) -> Any:
        """Return the recording as a data set of xarray: each axis with its unit, along "time" in s."""
        from gmwm.recording.writers import xarray_of

        return xarray_of(self)

    def _repr_html_(self) -> str:
        from gmwm.recording.writers import html_of

        return html_of(self)

    def longest(self) -> Imu:
        """Return the longest segment as a recording without gaps; its remarks say so."""
        if len(self.segments) == 1:
            return self
        leading = self[self.axes[0]]
        k = max(range(len(self.segments)), key=lambda k: self.segments[k][1] - self.segments[k][0])
        first, last = self.segments[k]
        begin, base = begins_of(leading.rate, leading.segments, leading.starts)[k], self.time_base
        # Time stamps step backward between segments only, so a single segment has no gap and no such step.
        base = base and replace(base, start=leading.starts[k], gaps=(), backward=0, left=base.left + begin)
        remark = Remark.of("cut", case="segment", segments=len(self.segments), first=first, last=last - 1)
        signals = {axis: signal.longest() for axis, signal in self.signals.items()}
        return replace(self[first:last], signals=signals, remarks=(*self.remarks, remark), time_base=base)


def _as_signal(x: Any, axis: str) -> Signal:
    """Return a signal, or an array in SI units as a signal whose times count samples."""
    return x if isinstance(x, Signal) else Signal(as_vector(x, axis), 1.0, unit=si_unit(axis), axis=axis)


def _columns(array: ArrayLike, axes: Sequence[str]) -> dict[str, ArrayLike]:
    """Return the columns of a two-dimensional array by axis name."""
    table = np.asarray(array)
    if table.ndim != 2 or table.shape[1] != len(axes):
        transposed = table.ndim == 2 and table.shape[0] == len(axes)
        raise DataError(
            argument="arrays", got=table.shape,
            expected=f"a mapping or an array of shape (N, {len(axes)}) with columns {', '.join(axes)}",
            advice="Pass its transpose." if transposed else "",
        )  # fmt: skip
    return {axis: table[:, k] for k, axis in enumerate(axes)}
