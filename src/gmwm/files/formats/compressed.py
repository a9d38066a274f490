"""Read text that is compressed with gzip or Zstandard. It is unpacked while the reader of its text format reads it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

from gmwm.base.errors import ReadError
from gmwm.files.contract import HEAD_BYTES, Layout, Reader, Rows, register
from gmwm.files.formats.byte_sources import GZIP, ZSTD, CompressedSource, FileSource
from gmwm.files.formats.text import TextReader, text_reader


@register
class CompressedReader(Reader):
    """Reader for text that is compressed as .gz or .zst."""

    name: ClassVar[str] = "compressed"
    extensions: ClassVar[tuple[str, ...]] = (".gz", ".zst", ".zstd")

    def sniff(self, path: Path, head: bytes) -> float:
        """Return 0.9 for the signatures of gzip and Zstandard, because another format may also be compressed."""
        return 0.9 if head.startswith((GZIP, ZSTD)) else 0.0

    def layouts(self, path: Path) -> tuple[Layout, ...]:
        """Return the recordings in the compressed text."""
        source = CompressedSource(path)
        reader, layouts = packed_text(source, path.with_suffix(""))
        return tuple(replace(layout, state=(reader, layout)) for layout in layouts)

    def chunks(self, path: Path, layout: Layout, wanted: Sequence[int]) -> Iterator[Rows]:
        """Yield the numbers; the text is unpacked while it is read."""
        reader, inner = layout.state
        inner = replace(inner, skip_bad_lines=layout.skip_bad_lines)
        return reader.rows(CompressedSource(path), inner, wanted)  # type: ignore[no-any-return]


def packed_text(source: FileSource, name: Path) -> tuple[TextReader, tuple[Layout, ...]]:
    """Return the reader of the text in a compressed file, and the recordings in it."""
    with source.open() as file:
        head = file.read(HEAD_BYTES)
    if not head:
        raise ReadError(
            f"{source} is empty when unpacked", code="empty", advice="Check whether the recording was interrupted."
        )
    reader = text_reader(name, head)
    if reader is None:
        raise ReadError(
            f"{source} is not text when unpacked, and only text is read from compressed files",
            code="not-text",
            advice="Unpack it and pass the file in it.",
        )
    return reader, reader.layouts_of(source)
