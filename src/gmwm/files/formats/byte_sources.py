"""Sources of bytes: a file, a compressed file, or a member of a zip archive.

Unpacked bytes are counted: decompression bombs raise an error before they fill the disk, as do truncated files."""

from __future__ import annotations

import gzip
import io
import sys
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import IO, TYPE_CHECKING, Any, BinaryIO, ClassVar, cast

from gmwm.base.errors import ReadError
from gmwm.files.contract import HEAD_BYTES

if TYPE_CHECKING:
    from _typeshed import WriteableBuffer

MAX_BYTES = 64 << 30  # largest size of a decompressed recording (bytes): ten days of six axes at 1 kHz as text

MAX_RATIO = 200
"""Largest compression ratio; noise compresses 20 times at most. Pinned by tests/readers/test_compressed.py."""

RATIO_FROM = 64 << 20
"""Number of unpacked bytes from which on the ratio is checked. The data of a smaller file can be very regular."""

MAX_MEMBERS = 1000  # largest number of files in an archive; phones export about ten tables

GZIP, ZSTD, ZIP = b"\x1f\x8b", b"\x28\xb5\x2f\xfd", b"PK\x03\x04"  # the first bytes of compressed files and archives


class PackedError(ReadError):
    """Packed bytes that cannot be unpacked: damaged, truncated, encrypted, or larger than the limits."""


@dataclass(frozen=True)
class FileSource:
    """A file as a source of bytes. `str()` of a source is its name in messages."""

    path: Path
    seekable: ClassVar[bool] = True
    """Whether the end can be read without decompressing or converting everything before it."""

    def __str__(self) -> str:
        return str(self.path)

    @property
    def unpacked_path(self) -> Path:
        """The name of the unpacked file."""
        return self.path

    def open(self) -> BinaryIO:
        """Open the bytes for reading."""
        try:
            return self.path.open("rb")
        except OSError as error:
            raise ReadError(
                f"{self.path} cannot be opened: {error.strerror}",
                code="not-readable",
                advice="Check the permissions of the file.",
            ) from error


@dataclass(frozen=True)
class CompressedSource(FileSource):
    """The bytes inside a gzip or Zstandard file. The first bytes show the compression."""

    seekable = False

    @property
    def unpacked_path(self) -> Path:
        """The name of the unpacked file."""
        return self.path.with_suffix("")

    def open(self) -> BinaryIO:
        """Open the decompressed bytes, with limits on their number."""
        with super().open() as file:
            magic = file.read(4)
        packed = self.path.stat().st_size
        if magic.startswith(GZIP):
            return _limit(cast("IO[bytes]", gzip.open(self.path, "rb")), str(self), packed)
        return _limit(zstd_library().open(self.path, "rb"), str(self), packed)


@dataclass(frozen=True)
class MemberSource(FileSource):
    """The bytes of one member of a zip archive."""

    member: str = ""
    seekable = False

    def __str__(self) -> str:
        return f"{self.path}:{self.member}"

    @property
    def unpacked_path(self) -> Path:
        """The name of the unpacked file."""
        return Path(self.member)

    def open(self) -> BinaryIO:
        """Open the decompressed bytes, with limits on their number."""
        archive = open_archive(self.path)
        info = archive.getinfo(self.member)
        if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            archive.close()
            # The library unpacks blocks of the other compression methods as a whole, so a few kB can become gigabytes.
            raise PackedError(
                f"{self} is compressed with method {info.compress_type}; only deflate is read in zip archives",
                code="unsupported",
                advice="Unpack the archive and pass the file in it.",
            )
        if info.flag_bits & 1:
            archive.close()
            raise PackedError(f"{self} is encrypted", code="encrypted", advice="Unpack it with its password first.")
        try:
            return _limit(archive.open(info), str(self), info.compress_size, archive)
        except (OSError, NotImplementedError, zipfile.BadZipFile, RuntimeError, ValueError) as error:
            archive.close()
            raise PackedError(
                f"{self} cannot be unpacked ({error})",
                code="damaged",
                advice="Unpack the archive and pass the file in it.",
            ) from error


@dataclass(frozen=True)
class ConvertedSource(FileSource):
    """The bytes of a source that are converted to a table of text while they are read."""

    inner: FileSource
    seekable = False

    def __str__(self) -> str:
        return str(self.inner)

    @property
    def unpacked_path(self) -> Path:
        """The name of the unpacked file."""
        return self.inner.unpacked_path


@dataclass(frozen=True)
class RecodedSource(ConvertedSource):
    """The text of a source in UTF-16 or with bare carriage returns, in UTF-8 with line feeds."""

    encoding: str

    def open(self) -> BinaryIO:
        """Open the recoded bytes. Bytes that are not UTF-8 are kept."""
        errors = "surrogateescape" if self.encoding == "utf-8" else "replace"
        text = io.TextIOWrapper(self.inner.open(), self.encoding, errors, newline=None)
        blocks = (part.encode("utf-8", errors) for part in iter(lambda: text.read(1 << 16), ""))
        return io.BufferedReader(BlockStream(blocks, text), 1 << 18)


def recoded(source: FileSource) -> FileSource:
    """Return a source of UTF-8 with line feeds, whatever the encoding and the line ends of its text."""
    with source.open() as file:
        head = file.read(HEAD_BYTES)
    encoding = text_encoding(head)
    if not encoding and b"\n" not in head and head.rstrip(b"\r").count(b"\r"):
        encoding = "utf-8"
    return RecodedSource(source.path, source, encoding) if encoding else source


def text_encoding(head: bytes) -> str:
    """Return the encoding of UTF-16 text, by its mark or by zeros in every second byte, or of Chinese text; else "".

    >>> text_encoding("time,gx".encode("utf-16-be")), text_encoding(b"time,gx")
    ('utf-16-be', '')
    """
    if head.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "utf-16"
    if "速度".encode("gb18030") in head:  # end of the names of accelerations and angular rates in Chinese
        return "gb18030"
    halves = {"utf-16-be": head[::2], "utf-16-le": head[1::2]}
    name = next((name for name, half in halves.items() if head[1:] and 3 * half.count(0) > 2 * len(half)), "")
    return name if name and "".join(head[:400].decode(name, "replace").split()).isprintable() else ""


def zstd_library() -> ModuleType:
    """Return the Zstandard module: from the standard library since Python 3.14, from a backport before."""
    if sys.version_info >= (3, 14):
        from compression import zstd  # novermin
    else:
        from backports import zstd
    return zstd


def open_archive(path: Path) -> zipfile.ZipFile:
    """Open a zip archive, after a check of the number of its members."""
    try:
        archive = zipfile.ZipFile(path)
    except (OSError, zipfile.BadZipFile, NotImplementedError, ValueError) as error:
        raise PackedError(
            f"{path} is not a complete zip archive ({error})", code="incomplete", advice="Copy the file again."
        ) from error
    if len(archive.infolist()) > MAX_MEMBERS:
        archive.close()
        raise PackedError(
            f"{path} holds more than {MAX_MEMBERS} files",
            code="too-many",
            advice="Unpack it and pass the recording in it.",
        )
    return archive


def file_names(archive: zipfile.ZipFile) -> list[str]:
    """Return the names of the files in an archive, without folders and damaged names."""
    return [name for info in archive.infolist() if (name := info.filename) and not name.endswith("/")]


def require_ratio(unpacked: int, packed: int, name: object) -> None:
    """Raise an error if the ratio of unpacked to packed bytes is larger than any recording can have."""
    if unpacked > MAX_BYTES or (unpacked > RATIO_FROM and unpacked > MAX_RATIO * packed):
        raise PackedError(
            f"{name} unpacks from {packed / 1e6:.3g} MB to {unpacked / 1e6:.0f} MB or more, unlike any recording",
            code="too-large",
            advice="If it is a recording, unpack it first.",
        )


def _limit(stream: IO[bytes], name: str, packed: int, owner: zipfile.ZipFile | None = None) -> BinaryIO:
    return io.BufferedReader(_CountingStream(stream, name, packed, owner), 1 << 18)


class BlockStream(io.RawIOBase):
    """A stream of blocks of bytes, which a file is converted to."""

    def __init__(self, blocks: Iterator[bytes], file: IO[Any]) -> None:
        self._blocks, self._file, self._rest = blocks, file, b""

    def readable(self) -> bool:
        """Return True: the bytes can be read."""
        return True

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Read the next bytes into a buffer."""
        view = memoryview(buffer).cast("B")
        while not self._rest:
            block = next(self._blocks, None)
            if block is None:
                return 0
            self._rest = block
        data, self._rest = self._rest[: len(view)], self._rest[len(view) :]
        view[: len(data)] = data
        return len(data)

    def close(self) -> None:
        """Close the stream and the file."""
        self._file.close()
        super().close()


class _CountingStream(io.RawIOBase):
    """A stream that counts unpacked bytes. It converts errors of the libraries to `PackedError`."""

    def __init__(self, stream: IO[bytes], name: str, packed: int, owner: zipfile.ZipFile | None) -> None:
        self._stream, self._name, self._packed, self._owner = stream, name, packed, owner
        self._count = 0

    def readable(self) -> bool:
        """Return True: the bytes can be read."""
        return True

    def tell(self) -> int:
        """Return the number of unpacked bytes so far."""
        return self._count

    def readinto(self, buffer: WriteableBuffer) -> int:
        """Read the next bytes into a buffer."""
        view = memoryview(buffer).cast("B")
        try:
            data = self._stream.read(len(view))
        except (OSError, EOFError, zlib.error, zipfile.BadZipFile, zstd_library().ZstdError) as error:
            where = f" after {self._count} unpacked bytes" if self._count else ""
            raise PackedError(
                f"{self._name} is damaged or truncated{where} ({error})", code="damaged", advice="Copy the file again."
            ) from error
        view[: len(data)] = data
        self._count += len(data)
        require_ratio(self._count, self._packed, self._name)
        return len(data)

    def close(self) -> None:
        """Close the stream and the compressed file."""
        if not self.closed:
            self._stream.close()
            if self._owner is not None:
                self._owner.close()
        super().close()
