"""Stream a recording in SI units, in chunks of samples, from a file that may be larger than memory.

Units come from the first rows, rate and segments from all time stamps, which are read first. Values, segments and their
times are the same as those of `read`.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from gmwm.options import BadLines, Columns, ReadOptions, as_whole_number
from gmwm.readers.api import (
    column_words,
    one_layout,
    require_time,
    timing_of,
    usable_samples,
)
from gmwm.readers.axis_units import resolve, time_unit
from gmwm.readers.base import Layout, Reader, Rows, existing_file, find_reader
from gmwm.readers.chunks import Chunk as Chunk
from gmwm.readers.chunks import ChunkBuilder, Interpretation
from gmwm.readers.columns import Choice, choose
from gmwm.readers.lost_samples import as_floats, is_missing, sift
from gmwm.readers.reading_warnings import STAMPS, of_file, warn
from gmwm.readers.running_clock import Pace
from gmwm.readers.scale_factors import multiply
from gmwm.readers.several_files import SeveralFiles, Source, files_of, found_reader, source_words
from gmwm.readers.time_stamps import Timing, as_stamps
from gmwm.readers.trimming import Kept, trimmed
from gmwm.remarks import Remark
from gmwm.time_base import TimeBase
from gmwm.time_ranges import range_texts

if TYPE_CHECKING:
    from distributed import Client

    from gmwm.readers.parts import Part
    from gmwm.spectrum import PowerSpectra
    from gmwm.spectrum.welch import Detrend
    from gmwm.variance.axes_result import WaveletVariances

T = TypeVar("T")

HEAD = 1 << 18
"""Rows from which units, rate and unit of time stamps are found, at least: 44 min at 100 Hz, over which time stamps of
1 ms give the rate to better than 1e-6 of itself."""

CHUNK = 1_000_000
"""Samples in a chunk, if no other number is asked for."""
LARGE = 300_000_000
"""Size of a file (bytes) from which commands and fleets stream it. It is a choice: smaller files fit into the memory of
any computer together with the copies that an estimate needs."""


def is_large(path: Path) -> bool:
    """Whether commands and fleets stream a file, or several by their pattern, instead of reading it."""
    files = [Path(file) for file in files_of(path)]
    return sum(file.stat().st_size for file in files if file.is_file()) >= LARGE


@dataclass(frozen=True, eq=False)
class Origin:
    """The file of a recording, its reader, the columns that are read, and the topic that was given."""

    path: Path
    reader: Reader
    layout: Layout
    wanted: tuple[int, ...]
    topic: str | None

    def chunks(self) -> Iterator[Rows]:
        """Iterate over all rows."""
        return self.reader.chunks(self.path, self.layout, self.wanted)


class Stream:
    """A recording in a file, to iterate over chunk by chunk. Each iteration reads the file again.

    Attributes
    ----------
    source : str
        The file.
    rate : float
        Samples per second (Hz).
    axes : tuple of str
        Names of the axes, gyroscopes first.
    time_base : TimeBase
        Properties of the time stamps; of a live stream those of the first rows, and after an iteration of all rows.
    remarks : tuple of Remark
        How the file was understood.
    """

    def __init__(
        self,
        source: str,
        found: Interpretation,
        chunks: Callable[[], Iterator[Rows]],
        size: int,
        origin: Origin | None = None,
        kept: Kept | None = None,
    ) -> None:
        self.source, self.rate, self.axes, self.remarks = source, found.rate, found.choice.axes, found.remarks
        self.time_base = found.timing.base
        self._found, self._chunks, self._size, self._origin, self._kept = found, chunks, size, origin, kept
        if kept is not None:
            self.remarks = (*self.remarks, Remark.of("cut", known="no", ranges=range_texts(kept)))

    def wavelet_variance(
        self,
        *,
        levels: int | None = None,
        exact: int | None = None,
        robust: bool = False,
        efficiency: float = 0.6,
        passes: int = 2,
        confidence: float = 0.95,
        threads: int | None = None,
        scheduler: str | Client | None = None,
        workers: int | None = None,
        parts: int | None = None,
        done: Callable[[int], None] | None = None,
    ) -> WaveletVariances:
        """Compute the wavelet variance of each axis; a robust estimate reads the recording twice by default.

        By default, the wavelet variance of up to 8.4 million samples of six axes is that of `gmwm.wavelet_variance`, to
        the last bit. Of more samples, the levels after `exact` use the coefficients at every τ/64-th sample, see
        `WaveletAccumulator`; a remark says so. Segments between gaps are measured together; no coefficient spans a gap.

        Parameters
        ----------
        levels : int, optional
            Number of levels J; by default all that have a coefficient.
        exact : int, optional
            Number of levels that use every coefficient of 2^exact samples or more, 6 to 24. By default as many as fit
            into 512 MiB: 21 for six axes. Workers return what they know of a part; their default is 19 for six axes.
        robust, efficiency : bool, float
            As for `gmwm.wavelet_variance`.
        passes : 2 or 1
            Number of times that a robust estimate reads a recording that exceeds this memory. Two passes are exact
            and give the slope, see `SecondPass`. One pass agrees to 1e-4 with the estimate from all coefficients, and
            to 5e-3 at a level with so many outliers that only the median is left.
        confidence : float
            Confidence level of the limits, between 0 and 1.
        threads : int, optional
            Number of axes to process in parallel; by default the number of processors.
        scheduler, workers, parts : optional
            To read parts of the recording in other processes: a Dask scheduler, or a number of processes to start here,
            and the number of parts.
        done : callable, optional
            Called in this thread with the number of samples so far after every chunk. A second pass continues the
            count, up to twice the number of samples.

        Returns
        -------
        WaveletVariances
            Mapping of axis to WaveletVariance, with `plot()` and `summary()` of all axes.

        Raises
        ------
        ReadError, DataError
            If `read` would refuse the data, when the data are reached; or if the recording changed between two passes.
        OptionError
            If an option is unknown or out of range.

        Examples
        --------
        >>> import tempfile, pathlib, gmwm
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = pathlib.Path(folder.name, "static.parquet")
        >>> gmwm.simulate({"gyro_x": "WN(sigma2=1e-6)"}, rate=100.0, samples=5_000, rng=1).write(path)
        >>> gmwm.stream(path).wavelet_variance()
        WaveletVariances(gyro_x: haar, 12 levels, 5000 samples at 100 Hz)
        >>> folder.cleanup()
        """
        from gmwm.streaming.passes import stream_variance

        return stream_variance(
            self,
            levels=levels,
            exact=exact,
            robust=robust,
            efficiency=efficiency,
            passes=passes,
            confidence=confidence,
            threads=threads,
            scheduler=scheduler,
            workers=workers,
            parts=parts,
            done=done,
        )

    def psd(
        self,
        *,
        length: int | None = None,
        detrend: Detrend = "constant",
        confidence: float = 0.95,
        done: Callable[[int], None] | None = None,
    ) -> PowerSpectra:
        """Estimate the power spectral density of each axis in one pass; see `gmwm.psd`.

        Parameters
        ----------
        length, detrend, confidence
            As for `gmwm.psd`.
        done : callable, optional
            Called with the number of samples so far after every chunk.

        Returns
        -------
        PowerSpectra
            Mapping of axis to PowerSpectrum.

        Raises
        ------
        ReadError, DataError
            If `read` would refuse the data, when the data are reached; or if no segment has 64 samples.
        OptionError
            If an option has an invalid value.
        """
        from gmwm.streaming.passes import stream_psd

        return stream_psd(self, length=length, detrend=detrend, confidence=confidence, done=done)

    def parts(self, count: int) -> tuple[Part, ...]:
        """Split the recording into consecutive parts of about the same length, to be read in other processes.

        Parquet, .npy, HDF5, .imu and .imr can be read from any row. So can text, whose lines are counted first in a
        pass that parses no numbers. Any other format is one part. Parts begin where the chunks of the reader do (2¹⁸ or
        2²⁰ rows, 8 MB of text), so a short recording has fewer parts.

        Parameters
        ----------
        count : int
            Largest number of parts.

        Returns
        -------
        tuple of Part
            In order. A part can be pickled; where it is read, the file must have the same path.

        Raises
        ------
        OptionError
            If the count is not a positive integer, or the stream does not come from a file.

        Examples
        --------
        >>> import tempfile, pathlib, gmwm
        >>> folder = tempfile.TemporaryDirectory()
        >>> path = pathlib.Path(folder.name, "static.imu.npy")
        >>> np.save(path, np.random.default_rng(1).normal(size=3_000_000))
        >>> source = gmwm.stream(path, 1000.0, ["gyro_x"], {"gyro": "deg/s"})
        >>> [(part.first, part.stop) for part in source.parts(2)]
        [(0, 1048576), (1048576, 3000000)]
        >>> folder.cleanup()
        """
        from gmwm.readers.parts import parts_of

        return parts_of(self, count)

    def __iter__(self) -> Iterator[Chunk]:
        everything = build_chunks(self._found, self._chunks(), size=self._size, path=self.source, ended=self._ended)
        if self._kept is None:
            return everything
        return trimmed(everything, self._kept, rate=self.rate, base=lambda: self.time_base, ended=self._ended)

    def _ended(self, base: TimeBase) -> None:
        self.time_base = base

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process opens the file again.
        if self._origin is None:
            raise TypeError("a recording that is still being written cannot be sent to another process")
        if isinstance(self._origin.reader, SeveralFiles):
            raise TypeError("a recording in several files cannot be sent to another process")
        origin = self._origin
        skip = origin.layout.skip_bad_lines
        return _again, (origin.path, origin.reader.name, origin.topic, skip, self._found, self._size, self._kept)

    def __repr__(self) -> str:
        return f"Stream({', '.join(self.axes)} at {self.rate:g} Hz, from {self.source})"


def stream(
    path: Source,
    rate: float | None = None,
    columns: Columns | None = None,
    units: Mapping[str, str] | None = None,
    *,
    chunk: int = CHUNK,
    format: str | None = None,
    scale: Mapping[str, float] | None = None,
    increments: bool | Sequence[str] = (),
    topic: str | None = None,
    start: float | None = None,
    stop: float | None = None,
    skip: Sequence[tuple[float, float]] = (),
    bad_lines: BadLines = "error",
) -> Stream:
    """Stream a static recording from a file in rad/s and m/s², chunk by chunk, for files larger than memory.

    Units, rate and the unit of time stamps come from the first rows, at least 2¹⁸ of them. Memory does not grow with
    the file if it is text, Parquet, .npy, HDF5 or .imu; files that are compressed as a whole (.npz, zip, MATLAB) are
    unpacked as a whole. The values are the same as those of `read`, and gaps in the time stamps begin segments as
    there. For a longer file `read` finds the rate from all rows; pass `rate` if jitter makes a difference.
    `.wavelet_variance()` measures all axes in one pass.

    Parameters
    ----------
    path, rate, columns, units, format, scale, increments, topic, start, stop, skip, bad_lines
        As for `read`. Nothing after `stop` is read.
    chunk : int
        Samples in a chunk, at most.

    Returns
    -------
    Stream
        Iterate over it to get the chunks, as often as needed.

    Raises
    ------
    ReadError, UnitError, DataError, OptionError
        As `read`. An error after the first rows is raised when the iteration reaches it.

    Warns
    -----
    InferredUnitWarning
        If the unit of the accelerometers was inferred from their norm.
    TimeBaseWarning
        If the file states another rate than its time stamps show, or if time stamps repeat, step backward or jitter.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> folder = tempfile.TemporaryDirectory()
    >>> path = pathlib.Path(folder.name, "static.csv")
    >>> rows = "".join(f"{k / 100 + (k > 5):.2f},{(-1) ** k * 0.1}\\n" for k in range(16))
    >>> _ = path.write_text("time,gyro_x [rad/s]\\n" + rows)
    >>> sorted({(chunk.segment, chunk.values["gyro_x"].size <= 4) for chunk in stream(path, chunk=4)})
    [(0, True), (1, True)]
    >>> folder.cleanup()
    """
    options = ReadOptions(
        rate=rate, columns=columns, units={} if units is None else units, start=start, stop=stop, skip=skip,
        format=format, topic=topic, scale={} if scale is None else scale, increments=increments, bad_lines=bad_lines,
    )  # fmt: skip
    return stream_file(path, options, as_whole_number(chunk, "chunk", 1))


def stream_file(path: Source, options: ReadOptions, chunk: int = CHUNK) -> Stream:
    """The recording in a file, as `stream` gives it, by options that are checked; all its segments are kept."""
    file, reader = found_reader(path, options.format)
    layout = one_layout(reader, file, options.topic)
    choice = streamed(choose(layout, options.columns, file))
    require_time(layout, choice, options.rate, file)
    layout = layout.read_as(options.bad_lines, "time" in choice.columns)
    head = first_rows(reader.chunks(file, layout, list(choice.columns.values())), choice)
    stamps = None
    if "time" in choice.columns:
        stamps = TimeColumn(reader, file, layout, choice)
    found = understand(layout, choice, head, path=file, options=options, stamps=stamps)
    warn(found.remarks, stacklevel=3)
    wanted = tuple(found.choice.columns.values())
    origin = Origin(file, reader, layout=layout, wanted=wanted, topic=options.topic)
    return Stream(
        source=source_words(path), found=found, chunks=origin.chunks, size=chunk, origin=origin, kept=options.ranges
    )


class TimeColumn:
    """The time stamps of all rows that the clock of a recording counts, in chunks, from a pass over the file.

    Parameters
    ----------
    reader, path, layout, choice
        The recording.

    Attributes
    ----------
    alone : bool
        Whether only the column of the time stamps is read. Rows without a time stamp or without a value in any axis are
        left out by the values of all columns; a recording whose first rows have all values is assumed to have none.
    sparse : bool
        Whether rows were left out.
    """

    def __init__(self, reader: Reader, path: Path, layout: Layout, choice: Choice) -> None:
        self._reader, self._path, self._layout, self._choice = reader, path, layout, choice
        self.alone, self.sparse = True, False

    def __iter__(self) -> Iterator[NDArray[Any]]:
        columns = self._choice.columns
        time, wanted = columns["time"], [columns["time"]] if self.alone else list(columns.values())
        for rows in self._reader.chunks(self._path, self._layout, wanted):
            if self.alone:
                if is_missing(rows[time]) is not None:
                    raise _UnplacedRowsError
                yield rows[time]
                continue
            sifted = sift(rows, columns, self._choice.axes)
            self.sparse |= bool(sifted.unplaced or sifted.other)
            yield sifted.rows[time]

    def of(self, clock: Callable[[Iterable[NDArray[Any]]], T]) -> T:
        """What `clock` finds in them, by all columns if the time stamps alone do not suffice."""
        try:
            return clock(self)
        except _UnplacedRowsError:
            self.alone = False
            return clock(self)


class _UnplacedRowsError(Exception):
    """Rows without a time stamp."""


def _again(
    path: Path, format: str, topic: str | None, skip: bool, found: Interpretation, size: int, kept: Kept | None
) -> Stream:
    """The stream that was pickled. Its warnings were given when it was made."""
    reader = find_reader(existing_file(path), format)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        layout = replace(one_layout(reader, path, topic), skip_bad_lines=skip)
    origin = Origin(path, reader, layout=layout, wanted=tuple(found.choice.columns.values()), topic=topic)
    return Stream(source=source_words(path), found=found, chunks=origin.chunks, size=size, origin=origin, kept=kept)


def streamed(choice: Choice) -> Choice:
    """The columns that are streamed: axes and time."""
    return Choice({role: k for role, k in choice.columns.items() if role != "temperature"}, choice.remarks)


def first_rows(chunks: Iterable[Rows], choice: Choice, rows: int = HEAD) -> dict[int, NDArray[Any]]:
    """At least `rows` rows of each column, or all rows of a shorter recording."""
    parts, count = [], 0
    for some in chunks:
        parts.append(some)
        count += next(iter(some.values())).size
        if count >= rows:
            break
    return {k: np.concatenate([part[k] for part in parts] or [np.empty(0)]) for k in choice.columns.values()}


def understand(
    layout: Layout,
    choice: Choice,
    head: Rows,
    *,
    path: Path,
    options: ReadOptions,
    stamps: TimeColumn | None = None,
    dead: bool = True,
) -> Interpretation:
    """Find units and, with `dead`, the axes that work from the first rows, and the clock from all time stamps.

    `stamps` is None for a recording without time stamps and for a live stream, whose clock begins with the first rows.
    """
    rate, units, integrals = options.rate, options.units, options.integrals
    usable = usable_samples(head, layout, choice, path=path, dead=dead)
    raw, pace = usable.raw, None
    samples = next(iter(raw.values())).size

    def clock(chunks: Iterable[NDArray[Any]] | None) -> tuple[Timing, tuple[Remark, ...]]:
        return timing_of(layout, choice, units=units, stamps=chunks, samples=samples, rate=rate)

    if stamps is not None:
        stamps.alone = usable.sifted.lost is None and usable.sifted.cut is None and not usable.sifted.other
        time, time_remarks = stamps.of(clock)
    elif "time" in raw:
        time, time_remarks = clock([raw["time"]])
        unit = time_unit(layout, choice, units)[0] or as_stamps(raw["time"], "", rate)[0].unit
        pace = Pace.of(raw["time"], unit, time)
    else:
        time, time_remarks = clock(None)
    ones = {axis: np.ones(1) for axis in choice.axes}
    scale_remarks = multiply(layout, choice, factors=options.scale, increments=integrals, raw=ones, rate=time.base.rate)
    present = usable.present(raw)
    numbers = {axis: as_floats(present[axis]) * ones[axis] for axis in choice.axes}
    scales = resolve(layout, choice, declared=units, values=numbers, rate=time.base.rate, increments=integrals)
    live = choice.only(usable.axes)
    if stamps is not None and stamps.alone:
        live = Choice({role: k for role, k in live.columns.items() if role != "time"}, live.remarks)
    found = {axis: tuple(f for f in (float(ones[axis][0]), scales.units[axis].factor) if f != 1) for axis in live.axes}
    # The remarks on all time stamps of a live stream follow at the end of an iteration.
    about_time = (remark for remark in time.remarks if pace is None or remark.code not in STAMPS)
    remarks = (*layout.remarks, *choice.remarks, *usable.remarks, *scale_remarks, *scales.remarks, *time_remarks)
    return Interpretation(
        choice=live,
        words={role: column_words(layout, choice, role, path) for role in choice.columns},
        factors=found,
        timing=time,
        pace=pace,
        remarks=of_file((*remarks, *about_time), path),
        sparse=stamps is not None and stamps.sparse,
    )


def build_chunks(
    found: Interpretation,
    rows: Iterable[Rows],
    size: int,
    path: object,
    ended: Callable[[TimeBase], None] = lambda base: None,
) -> Iterator[Chunk]:
    """Build chunks of at most `size` samples from the rows of a file; at the end, call `ended` with the time base.

    Raises
    ------
    ReadError, DataError
        If `read` would raise it, when the iteration reaches it.
    """
    builder = ChunkBuilder(found, size)
    for some in rows:
        yield from builder.add(some)
    yield from builder.end()
    summary = builder.summary()
    remarks = summary.remarks(found)
    ended(summary.time_base(found))
    warn(of_file(remarks, path), stacklevel=2)
