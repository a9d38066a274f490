"""Stream text that is still being written: a growing file, or standard input."""

from __future__ import annotations

import io
import os
import queue
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import BinaryIO, cast

from gmwm.base.errors import ReadError
from gmwm.files.columns.columns import ColumnChoice, choose
from gmwm.files.contract import Layout, Rows
from gmwm.files.formats.byte_sources import FileSource
from gmwm.files.formats.text import TextReader, text_reader
from gmwm.files.readers.interpretation import require_time, understand, warn
from gmwm.files.readers.streams import Stream, first_rows
from gmwm.recording.options import ReadOptions

POLL_S = 0.2  # time between two checks for new data (s)
READ_BYTES = 1 << 20  # largest number of bytes in one read
HEAD_LINES = 256
"""Number of lines from which units, rate and time stamps are determined, unless they take too long to arrive."""
LEAST_HEAD_LINES = 24  # number of lines that are sufficient if the other lines do not arrive within some seconds

Take = Callable[[], bytes | None]
"""Function that returns the bytes since its last call, possibly none, or None at the end of the data."""


class GrowingFile:
    """The content of a growing file, from its beginning. `trouble` is the reason why reading ended, or ""."""

    def __init__(self, path: Path) -> None:
        self.path, self.trouble = path, ""
        try:
            self._file = path.open("rb")
        except OSError as error:
            raise ReadError(
                f"{path} cannot be opened: {error.strerror}",
                code="not-readable",
                advice="Check the permissions of the file.",
            ) from error
        self._taken = 0

    def __call__(self) -> bytes | None:
        """Return the bytes since the last call; None after the file was truncated or replaced."""
        if self.trouble:
            return None
        here = os.fstat(self._file.fileno())
        if here.st_size < self._taken:
            self.trouble = (
                f"{self.path} was truncated to {here.st_size} bytes while it was watched: what follows is another"
            )
        elif data := self._file.read(READ_BYTES):
            self._taken += len(data)
            return data
        else:
            self.trouble = self._replacement(here)
        return None if self.trouble else b""

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _replacement(self, here: os.stat_result) -> str:
        try:
            status = self.path.stat()
        except OSError:
            return f"{self.path} was removed while it was watched"
        if not os.path.samestat(here, status):
            return f"{self.path} was replaced by another file while it was watched"
        return ""


class GrowingPipe:
    """The content of a pipe, read in a separate thread, so that the caller does not block."""

    trouble = ""

    def __init__(self, stream: BinaryIO) -> None:
        self._ready: queue.Queue[bytes] = queue.Queue(maxsize=16)
        self._ended = False
        threading.Thread(target=self._pump, args=(stream,), daemon=True).start()

    def __call__(self) -> bytes | None:
        """Return the bytes since the last call; None at the end."""
        if self._ended:
            return None
        try:
            data = self._ready.get_nowait()
        except queue.Empty:
            return b""
        self._ended = not data
        return data or None

    def close(self) -> None:
        """Do nothing, because the caller owns the pipe."""

    def _pump(self, stream: BinaryIO) -> None:
        # Read without a buffer: a buffered reader holds a lock while it waits, so the interpreter could not exit.
        read = getattr(stream, "raw", stream).read
        data = b"-"
        while data:
            try:
                data = read(READ_BYTES)
            except (OSError, ValueError):
                data = b""
            self._ready.put(data)


class Lines:
    """Complete lines of growing text. `breathe` is called before each check for data, and ends reading if False. `idle`
    (s) counts from the first check without data, as the caller may work meanwhile."""

    def __init__(self, take: Take, breathe: Callable[[], bool], idle: float | None = None) -> None:
        self._take, self._breathe, self._idle, self.rest = take, breathe, idle, b""
        self._quiet_since: float | None = None
        self.ended = False

    def look(self) -> bytes:
        """Return the complete lines since the last call, possibly none."""
        goes_on = self._breathe()
        data = self._take() if goes_on else None
        if data is None or self._is_idle(data):
            self.ended = True
            return b""
        # Search only the new bytes, because an incomplete line may be long.
        cut = data.rfind(b"\n") + 1
        if not cut:
            self.rest += data
            return b""
        out, self.rest = self.rest + data[:cut], data[cut:]
        return out

    def _is_idle(self, data: bytes) -> bool:
        """Return whether no data have arrived for `idle` seconds."""
        now = time.monotonic()
        self._quiet_since = None if data else now if self._quiet_since is None else self._quiet_since
        return self._idle is not None and self._quiet_since is not None and now - self._quiet_since >= self._idle

    def wait(self) -> bytes:
        """Wait for the next complete lines; return empty bytes at the end."""
        while not self.ended:
            if lines := self.look():
                return lines
            if not self.ended:
                time.sleep(POLL_S)
        return b""


class _Live(io.RawIOBase):
    """A file object whose reads return the available bytes, starting with `begin`, and wait if there are none."""

    def __init__(self, begin: bytes, lines: Lines) -> None:
        self._ready, self._lines = begin, lines

    def read(self, size: int = -1) -> bytes:
        """Read at most `size` bytes; return empty bytes at the end."""
        if not self._ready:
            self._ready = self._lines.wait()
        size = len(self._ready) if size < 0 else size
        out, self._ready = self._ready[:size], self._ready[size:]
        return out

    def readline(self, size: int | None = -1) -> bytes:
        """Return the next line. Only the header is read line by line, and its lines are already available."""
        end = self._ready.find(b"\n") + 1
        return self.read(end or len(self._ready))


@dataclass(frozen=True)
class _GrowingText(FileSource):
    """The first bytes of a growing text, and all that follow unless `lines` is None. They can be read only once."""

    begin: bytes
    lines: Lines | None
    seekable = False

    def open(self) -> BinaryIO:
        """Open the text from its first byte on."""
        return io.BytesIO(self.begin) if self.lines is None else cast("BinaryIO", _Live(self.begin, self.lines))


@dataclass(frozen=True, eq=False)
class _LiveRows:
    """The rows of a growing text."""

    reader: TextReader
    text: _GrowingText
    layout: Layout

    def chunks(self, wanted: Sequence[int]) -> Iterator[Rows]:
        """Iterate over the rows, which is possible only once."""
        return self.reader.rows(self.text, self.layout, wanted)


def growing_stream(lines: Lines, path: Path, options: ReadOptions | None = None, *, patience: float = 5.0) -> Stream:
    """Make a stream, for one pass, from growing text after its first lines; `LEAST_HEAD_LINES` suffice after `patience`
    (s). Of `options`, only rate, columns, units, scale and increments are used."""
    options = ReadOptions() if options is None else options
    head = _first_lines(lines, patience)
    if not head:
        raise ReadError(
            f"{path} holds no whole line", code="empty", advice="Check whether the recording was interrupted."
        )
    reader = text_reader(path, head)
    if reader is None:
        raise ReadError(
            f"{path} is not a text file, and only text can be watched", code="not-text",
            advice="Read it when it is complete.",
        )  # fmt: skip
    layout = reader.layout(_GrowingText(path, head, None))
    choice = choose(layout, options.columns, path)
    choice = ColumnChoice({role: k for role, k in choice.columns.items() if role != "temperature"}, choice.remarks)
    require_time(layout, choice, options.rate, path)
    layout = replace(layout, skip_bad_lines=options.bad_lines == "skip")
    first = first_rows(reader.rows(_GrowingText(path, head, None), layout, list(choice.columns.values())), choice)
    interpretation = understand(layout, choice, first, path=path, options=options, source=None)
    interpretation = interpretation.mounted(options.mount)
    warn(interpretation.remarks, stacklevel=2)
    return Stream(str(path), interpretation, _LiveRows(reader, _GrowingText(path, head, lines), layout), READ_BYTES)


def _first_lines(lines: Lines, patience: float) -> bytes:
    """Read the first lines, from which columns, units and rate are determined."""
    parts: list[bytes] = []
    count, since = 0, time.monotonic()
    while count < HEAD_LINES and not lines.ended:
        part = lines.look()
        if part:
            parts.append(part)
            count += part.count(b"\n")
        elif count >= LEAST_HEAD_LINES and time.monotonic() - since > patience:
            break
        elif not lines.ended:
            time.sleep(POLL_S)
    return b"".join(parts)
