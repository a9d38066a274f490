"""Read records as tables of text: JSON objects, and messages of ROS that `rostopic echo` printed."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import BinaryIO, ClassVar

from gmwm.base.errors import ReadError
from gmwm.files.contract import Layout, Mark, Rows, register
from gmwm.files.formats.byte_sources import BlockStream, ConvertedSource, FileSource
from gmwm.files.formats.json_types import JsonType
from gmwm.files.formats.text import Place, TextReader


@dataclass(frozen=True)
class _JsonSource(ConvertedSource):
    """The rows of JSON objects, as text with commas."""

    @cached_property
    def type(self) -> JsonType:
        """The type of the first objects."""
        import polars as pl

        with self.inner.open() as file:
            head = [line for line in islice(_objects(file), 200) if _is_object(line)]
        try:
            return JsonType.of(head)
        except pl.exceptions.PolarsError as error:
            raise ReadError(
                f"{self} is not a list of JSON objects ({str(error).splitlines()[0]})", code="no-numbers",
                advice="Write one object for each sample, in a line of its own.",
            ) from error  # fmt: skip

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        return tuple(self.type.table([b"{}"]).columns)

    def open(self) -> BinaryIO:
        """Open the rows. A line that is not an object stays as it is, so that its error states the line."""
        file = self.inner.open()
        return io.BufferedReader(BlockStream(self._blocks(file), file), 1 << 18)

    def _blocks(self, file: BinaryIO) -> Iterator[bytes]:
        import polars as pl

        objects = _objects(file)
        while lines := list(islice(objects, 1 << 14)):
            try:
                yield self._rows(lines)
            except pl.exceptions.PolarsError:
                for line in lines:
                    yield self._rows([line]) if _is_object(line) else line.strip()[:60].replace(b",", b" ") + b"\n"

    def _rows(self, lines: Sequence[bytes]) -> bytes:
        table = self.type.table(lines)
        if table.height != len(lines):
            import polars as pl

            raise pl.exceptions.ComputeError("a line is blank")
        return table.select(self.names).write_csv(include_header=False).encode()


def _is_object(line: bytes) -> bool:
    try:
        return isinstance(json.loads(line), dict)
    except ValueError:
        return False


def _objects(file: BinaryIO) -> Iterator[bytes]:
    """Yield the JSON objects of a file, one in each line."""
    first = file.readline()
    if not first.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"["):
        yield first.removeprefix(b"\xef\xbb\xbf")
        yield from file
        return
    for entry in json.loads(first + file.read()):
        yield json.dumps(entry).encode()


@dataclass(frozen=True)
class _EchoSource(ConvertedSource):
    """The rows of messages that `rostopic echo` or `ros2 topic echo` printed, as text with commas."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of the columns."""
        with self.inner.open() as file:
            return tuple(_joined(next(_messages(file), {})))

    def open(self) -> BinaryIO:
        """Open the rows, one for each message."""
        file = self.inner.open()
        rows = (",".join(_joined(message).get(name, "") for name in self.names) + "\n" for message in _messages(file))
        return io.BufferedReader(BlockStream((row.encode() for row in rows), file), 1 << 18)


def _messages(file: Iterable[bytes]) -> Iterator[dict[str, str]]:
    """Yield the numbers in each message by their paths."""
    path: list[tuple[int, str]] = []
    message: dict[str, str] = {}
    for raw in file:
        line = raw.decode("latin-1").rstrip()
        if line == "---":
            if message:
                yield message
            path, message = [], {}
            continue
        key, mark, value = line.partition(":")
        indent, value = len(key) - len(key.lstrip()), value.strip()
        if not mark or key.lstrip().startswith("-"):
            continue
        path = [*((at, name) for at, name in path if at < indent), (indent, key.strip())]
        if re.fullmatch(r"[-+]?[\d.]+(?:e[-+]?\d+)?|nan", value, re.IGNORECASE):
            message[".".join(name for _, name in path)] = value
    if message:
        yield message


def _joined(message: dict[str, str]) -> dict[str, str]:
    """Return a message with the seconds and nanoseconds of its stamp as one number."""
    out = dict(message)
    for seconds, fraction in (("secs", "nsecs"), ("sec", "nanosec")):
        if f"header.stamp.{fraction}" in out and f"header.stamp.{seconds}" in out:
            whole = out.pop(f"header.stamp.{seconds}") + out.pop(f"header.stamp.{fraction}").zfill(9)
            out = {"header.stamp": whole} | out
    return out


class _RecordReader(TextReader):
    """Base class of the readers of records."""

    source: ClassVar[type[_JsonSource | _EchoSource]]

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
    source: ClassVar[type[_JsonSource | _EchoSource]] = _JsonSource

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if the file begins with an object, or with a list of objects."""
        return 0.9 if re.match(rb"(?:\xef\xbb\xbf)?\s*\[?\s*\{\s*\"", head) else 0.0


@register
class EchoReader(_RecordReader):
    """Reader of messages that `rostopic echo` or `ros2 topic echo` printed."""

    name: ClassVar[str] = "echo"
    extensions: ClassVar[tuple[str, ...]] = (".txt", ".yaml")
    source: ClassVar[type[_JsonSource | _EchoSource]] = _EchoSource

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 if messages with a header are separated by lines of three dashes."""
        return 0.9 if re.match(rb"(?s)\s*header:\s*\n\s+(?:seq|stamp):.*\n---\s*\n", head) else 0.0
