"""Read records as tables: JSON objects, and ROS messages printed by `rostopic echo`.

Fields have names of their paths (`gyro.x`, `acc[0]`); sec and nsec become nanoseconds."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from itertools import chain, islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import NDArray

from gmwm.base.documents import is_result
from gmwm.base.errors import ReadError
from gmwm.files.clock.missing_values import MISSING
from gmwm.files.contract import HEAD_BYTES, Layout, Mark, Rows, register
from gmwm.files.formats.byte_sources import BlockStream, ConvertedSource, FileSource
from gmwm.files.formats.line_forms import as_one_line, first_of_sample, shape_of
from gmwm.files.formats.text import Place, TextReader
from gmwm.files.formats.text_rows import as_text

if TYPE_CHECKING:
    import polars as pl


_STAMP = re.compile(r"(.*)\.(?:sec|secs|seconds)")
_FRACTIONS = ("nsec", "nsecs", "nanosec", "nanosecs", "nanos", "nanoseconds")


_NO_NUMBER = re.compile(rb"(?<=[:,\[\s])[+-]?(?:NaN|Infinity)\b")


def _joined(messages: Sequence[bytes]) -> BytesIO:
    """Return the lines of messages, with null for the NaN and Infinity of Python, which Polars does not know."""
    lines = b"\n".join(messages)
    # The search for a word takes a tenth of the time of the regular expression, which takes longer than Polars.
    has_words = b"NaN" in lines or b"Infinity" in lines
    return BytesIO(_NO_NUMBER.sub(b"null", lines) if has_words else lines)


@dataclass(frozen=True)
class JsonType:
    """The type of JSON messages, by their fields."""

    schema: pl.Schema
    elements: int  # number of elements of each list that are columns

    @classmethod
    def of(cls, messages: Sequence[bytes], name: object) -> JsonType:
        """Return the type of the first messages of `name`: float64 for numbers of at most 15 digits."""
        import polars as pl

        messages = [message.replace(b"\n", b" ") for message in messages if is_object(message)]
        try:
            schema = pl.read_ndjson(_joined(messages), infer_schema_length=None).schema
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            reason = f" ({str(error).splitlines()[0]})" if messages else ""
            raise ReadError(
                f"{name} holds no JSON objects{reason}", code="no-numbers",
                advice="Write one object for each sample, in a line of its own.",
            ) from error  # fmt: skip
        long = re.search(rb"(?<![\d.])\d{16,19}(?![\d.])", b"\n".join(messages[:10])) is not None
        lists = re.findall(rb"\[([^\[\]{}]*)\]", b" ".join(messages[:10]))
        # At most 9 numbers of a list become columns, as many as a covariance has.
        elements = min(max((part.count(b",") + 1 for part in lists), default=0), 9)
        return cls(pl.Schema({name: _plain(kind, long) for name, kind in schema.items()}), elements)

    def leaves(self) -> tuple[str, ...]:
        """Return the names of the numbers in every message."""
        import polars as pl

        columns = _flat(pl.DataFrame(schema=self.schema), self.elements).schema.items()
        return tuple(name for name, kind in columns if kind.is_numeric())

    def decoder(self, wanted: Sequence[str]) -> JsonDecoder:
        """Return a decoder of some numbers."""
        return JsonDecoder(self, wanted)

    def table(self, lines: Sequence[bytes]) -> pl.DataFrame:
        """Return the fields of messages as columns."""
        import polars as pl

        return _flat(pl.read_ndjson(_joined(lines), schema=self.schema, ignore_errors=True), self.elements)


@dataclass(frozen=True)
class JsonDecoder:
    """Decoder of the wanted numbers of JSON messages."""

    type: JsonType
    wanted: Sequence[str]

    def decode(self, messages: Sequence[bytes]) -> dict[str, NDArray[Any]]:
        """Return the wanted numbers of messages; NaN or `MISSING` where a message lacks one."""
        import polars as pl

        try:
            table = self.type.table([message.replace(b"\n", b" ") for message in messages])
        except (pl.exceptions.PolarsError, pl.exceptions.PanicException) as error:
            raise ReadError(
                f"a message is not JSON ({str(error).splitlines()[0]})", code="message-damaged",
                advice="Copy the file again.",
            ) from error  # fmt: skip
        columns = {name: table.get_column(name) for name in self.wanted}
        return {
            name: np.ascontiguousarray(
                (column.fill_null(MISSING) if column.dtype.is_integer() else column.cast(pl.Float64)).to_numpy()
            )
            for name, column in columns.items()
        }


def is_object(message: bytes) -> bool:
    """Return whether a message is a JSON object."""
    try:
        return isinstance(json.loads(message), dict)
    except (ValueError, RecursionError):
        return False


def _samples(document: Any) -> Iterable[Any]:
    """Return the samples of a document: a list of them, a column for each name, or a table of pandas in any form.

    >>> list(_samples({"columns": ["gx", "gy"], "index": [0], "data": [[1, 2]]}))
    [{'gx': 1, 'gy': 2}]
    >>> list(_samples({"gx": {"0": 1}, "gy": {"0": 2}})) == list(_samples({"0": {"gx": 1, "gy": 2}}))
    True
    """
    if not isinstance(document, dict) or not all(isinstance(value, dict | list) for value in document.values()):
        return document if isinstance(document, list) else [document]
    if isinstance(rows := document.get("data"), list):
        names = document.get("columns", ())
        return [dict(zip(names, row, strict=True)) if isinstance(row, list) else row for row in rows]
    if all(name.isdecimal() for name in document):
        return document.values()
    columns = [column.values() if isinstance(column, dict) else column for column in document.values()]
    return [dict(zip(document, row, strict=True)) for row in zip(*columns, strict=True)]


def _plain(kind: Any, long: bool) -> Any:
    """Return the type with which a field is read."""
    import polars as pl

    if isinstance(kind, pl.Struct):
        return pl.Struct({field.name: _plain(field.dtype, long) for field in kind.fields})
    if isinstance(kind, pl.List):
        return pl.List(_plain(kind.inner, long))
    return kind if (long and kind == pl.Int64) or not kind.is_numeric() else pl.Float64


def _flat(table: pl.DataFrame, elements: int) -> pl.DataFrame:
    """Return a table in which each field of an object and each element of a short list is a column."""
    import polars as pl

    columns: list[pl.Series] = []
    for column in table.get_columns():
        kind = column.dtype
        if isinstance(kind, pl.Struct):
            inner = column.struct.unnest() if kind.fields else pl.DataFrame()
            columns += _flat(
                inner.rename({name: f"{column.name}.{name}" for name in inner.columns}), elements
            ).get_columns()
        elif isinstance(kind, pl.List) and kind.inner.is_numeric():
            columns += [column.list.get(k, null_on_oob=True).alias(f"{column.name}[{k}]") for k in range(elements)]
        elif not isinstance(kind, pl.List):
            columns.append(column)
    flat = pl.DataFrame(columns)
    for name in flat.columns:
        stamp = _STAMP.fullmatch(name)
        fractions = [f"{stamp[1]}.{word}" for word in _FRACTIONS] if stamp else []
        fraction = next((column for column in fractions if column in flat.columns), "")
        if stamp and fraction:
            stamp_name = stamp[1] if stamp[1].endswith("header.stamp") else f"{stamp[1]}_ns"
            time = pl.col(name).cast(pl.Int64) * 10**9 + pl.col(fraction).cast(pl.Int64)
            flat = flat.select(time.alias(stamp_name), pl.exclude(name, fraction))
    return flat


@dataclass(frozen=True)
class _JsonSource(ConvertedSource):
    """The rows of JSON objects, as text with commas."""

    @cached_property
    def type(self) -> JsonType:
        """The type of the first objects."""
        with self.inner.open() as file:
            if is_result(file.read(200)):
                raise ReadError(
                    f"{self} is a result of gmwm, not a recording", code="no-inertial-data",
                    advice="Pass the recording that it was computed from.",
                )  # fmt: skip
        with self.inner.open() as file:
            return JsonType.of(list(islice(self.objects(file), 200)), self)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.type.table([b"{}"]).columns)

    def open(self) -> BinaryIO:
        """Open the rows. A line that is not an object stays as it is, so that its error states the line."""
        file = self.inner.open()
        return io.BufferedReader(BlockStream(self._blocks(file), file), 1 << 18)

    def objects(self, file: BinaryIO) -> Iterator[bytes]:
        """Yield the objects of a file, one in each line, or of a document with all samples (`_samples`)."""
        first = file.readline().removeprefix(b"\xef\xbb\xbf")
        second = next((line for line in file if not line.isspace()), b"")
        if second and not first.lstrip().startswith(b"[") and first.strip() != b"{":
            yield first
            yield from (line for line in chain([second], file) if not line.isspace())
            return
        try:
            entries = _samples(json.loads(first + second + file.read()))
        except (ValueError, RecursionError) as error:
            raise ReadError(
                f"{self} is not complete JSON ({error})", code="cut-off", advice="Copy the file again."
            ) from error
        yield from (json.dumps(entry).encode() for entry in entries)

    def _blocks(self, file: BinaryIO) -> Iterator[bytes]:
        import polars as pl

        objects = self.objects(file)
        while lines := list(islice(objects, 1 << 14)):
            try:
                yield self._rows(lines)
            except (pl.exceptions.PolarsError, pl.exceptions.PanicException):
                for line in lines:
                    yield self._rows([line]) if is_object(line) else line.strip()[:60].replace(b",", b" ") + b"\n"

    def _rows(self, lines: Sequence[bytes]) -> bytes:
        table = self.type.table(lines)
        if table.height != len(lines):
            import polars as pl

            raise pl.exceptions.ComputeError("a line is blank")
        return table.select(self.names).write_csv(include_header=False).encode()


@dataclass(frozen=True)
class _EchoSource(_JsonSource):
    """The rows of messages that `rostopic echo` or `ros2 topic echo` printed, as text with commas."""

    def objects(self, file: BinaryIO) -> Iterator[bytes]:
        """Yield the numbers in each message by their paths, as a JSON object."""
        path: list[tuple[int, str]] = []
        message: dict[str, str] = {}
        for line in (raw.decode("latin-1").rstrip() for raw in chain(file, [b"---"])):
            key, mark, value = line.partition(":")
            indent = len(key) - len(key.lstrip())
            path = [*((at, name) for at, name in path if at < indent), (indent, key.strip())]
            if line == "---" and message:
                yield f"{{{', '.join(f'{json.dumps(name)}: {number}' for name, number in message.items())}}}".encode()
                message = {}
            elif mark and re.fullmatch(r"\s*-?\d+(?:\.\d+)?(?:e[-+]?\d+)?", value):
                message[".".join(name for _, name in path)] = value


@dataclass(frozen=True)
class _JoinedSource(ConvertedSource):
    """The lines of each sample, as one line."""

    def open(self) -> BinaryIO:
        """Open the joined lines."""
        file = self.inner.open()
        return io.BufferedReader(BlockStream(self._blocks(file), file), 1 << 18)

    def _blocks(self, file: BinaryIO) -> Iterator[bytes]:
        with self.inner.open() as begin:
            first = first_of_sample(_lines(begin.read(HEAD_BYTES)))
        sample: list[str] = []
        for line in map(as_text, file):
            if sample and shape_of(line) == first:
                yield as_one_line(sample).encode() + b"\n"
                sample = []
            sample += [line] if line.strip() else []
        yield as_one_line(sample).encode() + b"\n"


def _lines(head: bytes) -> list[str]:
    """Return the complete lines in the first bytes of a file."""
    return list(map(as_text, head.split(b"\n")[:-1]))


class _RecordReader(TextReader):
    """Base class of the readers of records."""

    source: ClassVar[type[ConvertedSource]]

    def layouts_of(self, source: FileSource) -> tuple[Layout, ...]:
        """Return the recordings in records: several if a field states the sensor of each record."""
        return super().layouts_of(self.source(source.path, source))

    def marks(self, path: Path, layout: Layout) -> tuple[Mark, ...]:
        """Return no marks, because the records before a row must be converted first."""
        return ()

    def rows(
        self, source: FileSource, layout: Layout, wanted: Sequence[int], place: Place | None = None
    ) -> Iterator[Rows]:
        """Yield the numbers of the records."""
        yield from super().rows(self.source(source.path, source), layout, wanted, place)


@register
class JsonReader(_RecordReader):
    """Reader of JSON objects, one for each sample."""

    name: ClassVar[str] = "json"
    extensions: ClassVar[tuple[str, ...]] = (".json", ".jsonl", ".ndjson")
    source: ClassVar[type[ConvertedSource]] = _JsonSource

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if the file begins with an object, or with a list of objects."""
        return 0.9 if re.match(rb"(?:\xef\xbb\xbf)?\s*\[?\s*\{\s*\"", head) else 0.0


@register
class EchoReader(_RecordReader):
    """Reader of messages that `rostopic echo` or `ros2 topic echo` printed."""

    name: ClassVar[str] = "echo"
    extensions: ClassVar[tuple[str, ...]] = (".txt", ".yaml")
    source: ClassVar[type[ConvertedSource]] = _EchoSource

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if messages with a header are separated by lines of three dashes."""
        return 0.9 if re.match(rb"(?s)\s*header:\s*\n\s+(?:seq|stamp):.*\n---\s*\n", head) else 0.0


@register
class LinesReader(_RecordReader):
    """Reader of samples with labels in several lines, such as `Acceleration X: …` above `Rotation X: …`."""

    name: ClassVar[str] = "lines"
    extensions: ClassVar[tuple[str, ...]] = (".txt", ".log")
    source: ClassVar[type[ConvertedSource]] = _JoinedSource

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.6, a little more than for other text, if a sample has several lines with labels."""
        text = b"\0" not in head and (b":" in head or b"=" in head) and bool(first_of_sample(_lines(head)))
        return 0.6 if text else 0.0
