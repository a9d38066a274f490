"""Read records as tables of text: JSON objects, and messages of ROS that `rostopic echo` printed."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, islice
from pathlib import Path
from typing import BinaryIO, ClassVar

from gmwm.base.errors import ReadError
from gmwm.files.contract import HEAD_BYTES, Layout, Mark, Rows, register
from gmwm.files.formats.byte_sources import BlockStream, ConvertedSource, FileSource
from gmwm.files.formats.json_types import JsonType, is_object
from gmwm.files.formats.line_forms import first_of_sample, shape_of
from gmwm.files.formats.text import Place, TextReader


@dataclass(frozen=True)
class _JsonSource(ConvertedSource):
    """The rows of JSON objects, as text with commas."""

    @cached_property
    def type(self) -> JsonType:
        """The type of the first objects."""
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
        """Yield the objects of a file, one in each line."""
        first = file.readline()
        if not first.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"["):
            yield first.removeprefix(b"\xef\xbb\xbf")
            yield from (line for line in file if not line.isspace())
            return
        try:
            entries = json.loads(first + file.read())
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
            first = first_of_sample(begin.read(HEAD_BYTES).decode("latin-1").split("\n")[:-1])
        sample: list[bytes] = []
        for line in file:
            if sample and shape_of(line.decode("latin-1")) == first:
                yield b" ".join(sample) + b"\n"
                sample = []
            sample += [line.strip()] if line.strip() else []
        yield b" ".join(sample) + b"\n"


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
        text = b"\0" not in head and b":" in head and bool(first_of_sample(head.decode("latin-1").split("\n")[:-1]))
        return 0.6 if text else 0.0
