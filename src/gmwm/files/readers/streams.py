"""Read a recording chunk by chunk, in SI units, from a file that may be larger than memory."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np

from gmwm.base.errors import ReadError
from gmwm.base.remarks import Remark
from gmwm.base.time_base import TimeBase
from gmwm.files.clock.missing_values import CUT, as_floats
from gmwm.files.clock.time_stamps import are_intervals
from gmwm.files.columns.column_names import is_interval
from gmwm.files.columns.columns import ColumnChoice
from gmwm.files.contract import Layout, Reader, Rows
from gmwm.files.readers import interpretation
from gmwm.files.readers.builder import RowSummary, SampleBuilder
from gmwm.files.readers.interpretation import Interpretation, RowSource, of_file, warn
from gmwm.files.readers.topics import SeveralFiles, files_of, reopen, source_words
from gmwm.recording.chunks import Chunk, Samples
from gmwm.recording.options import Columns
from gmwm.recording.time_ranges import Trimmer, range_texts

if TYPE_CHECKING:
    from distributed import Client

    from gmwm.files.readers.parts import Part
    from gmwm.measuring.spectrum import PowerSpectra
    from gmwm.measuring.spectrum.welch import Detrend
    from gmwm.measuring.variance.result import WaveletVariances

CHUNK_SAMPLES = 1_000_000  # default number of samples in a chunk
STREAMED_BYTES = 300_000_000
"""File size (bytes) from which commands and fleets stream. Smaller files fit into any memory, with copies."""
Kept = Sequence[tuple[float, float]]  # ranges of time (s), in order


T = TypeVar("T")


def is_large(path: Path) -> bool:
    """Return whether a file, or all files of a pattern together, are so large that the commands stream them."""
    files = [Path(file) for file in files_of(path)]
    return sum(file.stat().st_size for file in files if file.is_file()) >= STREAMED_BYTES


def without_float_warnings(items: Iterator[T]) -> Iterator[T]:
    """Yield the items of a reader, without NumPy's warnings about damaged numbers, which are checked later."""
    while True:
        with np.errstate(all="ignore"):
            item = next(items, None)
        if item is None:
            return
        yield item


@dataclass(frozen=True, eq=False)
class FileRows:
    """The rows of a recording in a file. Each iteration reads them again."""

    path: Path  # the file, its reader, and the description of the recording
    reader: Reader
    layout: Layout
    topic: str | None  # name of the recording that the user chose; None if none was chosen
    # number of the first row, and of the row after the last one; None for all rows
    limits: tuple[int, int] | None = None
    intervals: int | None = None  # column with the times between rows, which are added up to time stamps

    def chunks(self, wanted: Sequence[int]) -> Iterator[Rows]:
        """Iterate over the rows of the wanted columns."""
        chunks = without_float_warnings(self.reader.chunks(self.path, self.layout, wanted))
        chunks = chunks if self.limits is None else _between(chunks, *self.limits)
        return chunks if self.intervals is None or self.intervals not in wanted else _add_up(chunks, self.intervals)

    def with_intervals(self, choice: ColumnChoice, columns: Columns | None) -> FileRows:
        """Return it with the column of the times between rows, if its name and its numbers make it the only clock."""
        named = [k for k, channel in enumerate(self.layout.channels) if is_interval(channel.name)]
        free = "time" not in choice.columns and (
            columns is None or (isinstance(columns, Mapping) and "time" not in columns)
        )
        if len(named) != 1 or self.layout.rate is not None or not (free or choice.columns.get("time") in named):
            return self
        try:
            rows = first_rows(self.chunks(named), ColumnChoice({"time": named[0]}))[named[0]]
        except ReadError:  # no numbers
            return self
        return replace(self, intervals=named[0]) if are_intervals(rows) else self

    def first(self, choice: ColumnChoice) -> Rows:
        """Return at least `HEAD_ROWS` rows of each column, or all rows of a shorter recording."""
        return first_rows(self.chunks(list(choice.columns.values())), choice)

    def limit(self, begin: int, end: int) -> FileRows:
        """Return the rows `begin` to `end` − 1."""
        return replace(self, limits=(begin, end))

    def hold(self, choice: ColumnChoice) -> HeldRows:
        """Read the chosen columns into memory, as float64 except the time stamps, which need the precision."""
        columns = list(choice.columns.values())
        parts: dict[int, list[Any]] = {k: [] for k in columns}
        cuts, marked = [], False
        for chunk in self.chunks(columns):
            for k in columns:
                parts[k].append(chunk[k])
            cuts.append(chunk.get(CUT, np.zeros(chunk[columns[0]].size, dtype=bool)))
            marked |= CUT in chunk
        rows = {CUT: np.concatenate(cuts)} if marked else {}
        for role, k in choice.columns.items():
            pieces = parts.pop(k)
            column = np.concatenate(pieces) if pieces else np.empty(0)
            rows[k] = column if role == "time" else as_floats(column)
        return HeldRows(rows)


@dataclass(frozen=True, eq=False)
class HeldRows:
    """The rows of a recording in memory."""

    rows: Rows

    def chunks(self, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield all rows of the wanted columns, at once."""
        yield {k: self.rows[k] for k in (*wanted, *([CUT] if CUT in self.rows else []))}

    def first(self, choice: ColumnChoice) -> Rows:
        """Return all rows."""
        return self.rows

    def limit(self, begin: int, end: int) -> HeldRows:
        """Return the rows `begin` to `end` − 1."""
        return HeldRows({k: column[begin:end] for k, column in self.rows.items()})


def first_rows(chunks: Iterator[Rows], choice: ColumnChoice) -> Rows:
    """Return at least `HEAD_ROWS` rows of each column, or all rows of a shorter recording."""
    parts, count = [], 0
    for chunk in chunks:
        parts.append(chunk)
        count += next(iter(chunk.values())).size
        if count >= interpretation.HEAD_ROWS:
            break
    return {k: np.concatenate([part[k] for part in parts] or [np.empty(0)]) for k in choice.columns.values()}


def _add_up(chunks: Iterator[Rows], column: int) -> Iterator[Rows]:
    """Yield the chunks with the sum of a column up to each row; missing values stay."""
    total = 0.0
    for rows in chunks:
        values = as_floats(rows[column])
        sums = total + np.nancumsum(values)
        total = sums[-1] if sums.size else total
        yield {**rows, column: np.where(np.isnan(values), values, sums)}


def _between(chunks: Iterator[Rows], begin: int, end: int) -> Iterator[Rows]:
    """Yield the rows `begin` to `end` − 1."""
    row = 0
    for chunk in chunks:
        size = next(iter(chunk.values())).size
        if row < end and row + size > begin:
            yield {k: column[max(begin - row, 0) : end - row] for k, column in chunk.items()}
        row += size
        if row >= end:
            return


class Stream:
    """A recording in a file that is read chunk by chunk. Each iteration reads the file again.

    Attributes
    ----------
    source : str
        Name of the file.
    rate : float
        Samples per second (Hz).
    axes : tuple of str
        Names of the axes, gyroscopes first.
    time_base : TimeBase
        Properties of the time stamps. For a live stream, they describe the first rows, and all rows after an iteration.
    remarks : tuple of Remark
        Remarks on how the file was interpreted.
    """

    def __init__(
        self, source: str, found: Interpretation, rows: RowSource, size: int = CHUNK_SAMPLES, kept: Kept | None = None
    ) -> None:
        self.source, self.rate, self.axes = source, found.rate, found.choice.axes
        self.time_base = found.timing.base
        self._found, self._rows, self._size, self._kept = found, rows, size, kept
        about_cut = [] if kept is None else [Remark.of("cut", case="cut", known="no", ranges=range_texts(kept))]
        self._remarks = self.remarks = (*found.remarks, *about_cut)

    @property
    def has_temperature(self) -> bool:
        """Whether the recording has a temperature."""
        return self._found.first_temperature is not None

    @property
    def rows(self) -> int:
        """Number of rows that the clock counts. Without time stamps, it is the number of rows that were read first."""
        return self._found.timing.segments[-1][1]

    def wavelet_variance(
        self,
        *,
        levels: int | None = None, exact: int | None = None, robust: bool = False, efficiency: float = 0.6,
        passes: int = 2, confidence: float = 0.95, threads: int | None = None, scheduler: str | Client | None = None,
        workers: int | None = None, parts: int | None = None, done: Callable[[int], None] | None = None,
    ) -> WaveletVariances:  # fmt: skip
        """Compute the wavelet variance of each axis; a robust estimate reads the recording twice by default.

        By default, the wavelet variance of up to 8.4 million samples of six axes equals the result of
        `gmwm.wavelet_variance` to the last bit. With more samples, the levels after `exact` use the coefficients at
        every τ/64-th sample, see `WaveletAccumulator`; a remark says so. Segments between gaps are measured together;
        no coefficient spans a gap.

        Parameters
        ----------
        levels : int, optional
            Number of levels J; by default all levels that have at least one coefficient.
        exact : int, optional
            Number of levels, 6 to 24, that use every coefficient. By default, as many as 512 MiB of memory allow: 21
            for six axes. With workers, the default is 19 for six axes, because each worker returns the samples at the
            ends of its part.
        robust, efficiency : bool, float
            As for `gmwm.wavelet_variance`.
        passes : 2 or 1
            Number of times that a robust estimate reads a recording that exceeds this memory. Two passes are exact, and
            also give the slope of the curve; see `SecondPass`. One pass agrees to 1e-4 with the estimate from all
            coefficients, and to 5e-3 at a level with so many outliers that only the median is left.
        confidence : float
            Confidence level of the limits, between 0 and 1.
        threads : int, optional
            Number of axes to process in parallel; by default the number of processors.
        scheduler, workers, parts : optional
            Options to read parts of the recording in other processes: `scheduler` is a Dask scheduler, `workers` is the
            number of processes to start on this computer, and `parts` is the number of parts.
        done : callable, optional
            Called in this thread with the number of samples so far after every chunk. A second pass continues the
            count, up to twice the number of samples.

        Returns
        -------
        WaveletVariances
            Mapping of axis to WaveletVariance, with the methods `plot()` and `summary()` for all axes.

        Raises
        ------
        ReadError, DataError
            In the same cases as `gmwm.read`, when the iteration reaches the data; or if the recording changed between
            two passes.
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
        from gmwm.measuring.streaming.passes import stream_variance

        return stream_variance(
            self, levels=levels, exact=exact, robust=robust, efficiency=efficiency, passes=passes,
            confidence=confidence, threads=threads, scheduler=scheduler, workers=workers, parts=parts, done=done,
        )  # fmt: skip

    def psd(
        self,
        *,
        length: int | None = None, detrend: Detrend = "constant", confidence: float = 0.95,
        done: Callable[[int], None] | None = None,
    ) -> PowerSpectra:  # fmt: skip
        """Estimate the power spectral density of each axis in one pass; see `gmwm.psd`.

        Parameters
        ----------
        length, detrend, confidence
            As for `gmwm.psd`.
        done : callable, optional
            Called with the number of samples so far after every chunk.

        Raises
        ------
        ReadError, DataError
            In the same cases as `gmwm.read`, when the iteration reaches the data; or if no segment has 64 samples.
        OptionError
            If an option has an invalid value.
        """
        from gmwm.measuring.streaming.passes import stream_psd

        return stream_psd(self, length=length, detrend=detrend, confidence=confidence, done=done)

    def parts(self, count: int) -> tuple[Part, ...]:
        """Split the recording into consecutive parts of about the same length, to be read in other processes.

        Parquet, .npy, HDF5, .imu and .imr files can be read from any row. Text can too, after a pass that counts its
        lines without parsing numbers. A file of any other format is one part. Each part begins with a chunk of the
        reader (2¹⁸ or 2²⁰ rows, or 8 MB of text), so a short recording has fewer parts.

        Parameters
        ----------
        count : int
            Largest number of parts.

        Returns
        -------
        tuple of Part
            The parts in order. A part can be pickled, and read on any computer on which the file has the same path.

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
        from gmwm.files.readers.parts import parts_of

        return parts_of(self, count)

    def samples(self) -> Iterator[Samples]:
        """Iterate over the samples as they are read, in `Samples` objects that state the gaps between them."""
        interpretation, trimmer = self._found, None if self._kept is None else Trimmer(self._kept, self.rate)
        builder, base = SampleBuilder(interpretation), interpretation.timing.base
        for samples in without_float_warnings(builder.samples(self._rows)):
            part = samples if trimmer is None else trimmer.take(samples)
            if part is not None:
                yield part
            if trimmer is not None and trimmer.done:
                break
        else:
            base = self._complete(builder.summary(), stacklevel=2)
        self.time_base = base if trimmer is None else trimmer.time_base(base)

    def _complete(self, summary: RowSummary, *, stacklevel: int) -> TimeBase:
        """Complete the remarks when all rows were read, and return the time base of all rows."""
        remarks = of_file(summary.remarks(self._found), self.source)
        self.remarks = (*self._remarks, *remarks)
        warn(remarks, stacklevel=stacklevel + 1)
        return summary.time_base(self._found)

    def __iter__(self) -> Iterator[Chunk]:
        for samples in self.samples():
            yield from samples.chunks(self._size)

    def __reduce__(self) -> tuple[Any, ...]:
        # Another process opens the file again.
        origin = self._rows
        if not isinstance(origin, FileRows):
            raise TypeError("a recording that is still being written cannot be sent to another process")
        if isinstance(origin.reader, SeveralFiles):
            raise TypeError("a recording in several files cannot be sent to another process")
        again = (origin.path, origin.reader.name, origin.topic, origin.layout.skip_bad_lines, origin.limits)
        return _again, (*again, self._found, self._size, self._kept)

    def __repr__(self) -> str:
        return f"Stream({', '.join(self.axes)} at {self.rate:g} Hz, from {self.source})"


def _again(
    path: Path, format: str, topic: str | None, skip: bool, limits: tuple[int, int] | None, found: Interpretation,
    size: int, kept: Kept | None,
) -> Stream:  # fmt: skip
    """Restore a pickled stream, without repeating its warnings."""
    reader, layout = reopen(path, format, topic, skip_bad_lines=skip)
    rows = FileRows(path, reader, layout, topic=topic, limits=limits)
    return Stream(source_words(path), found, rows, size=size, kept=kept)
