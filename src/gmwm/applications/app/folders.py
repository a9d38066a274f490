"""Access to the files that the page may open: files in the opened folder, and files dropped on the page."""

from __future__ import annotations

import re
import shutil
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from gmwm.base.errors import OptionError, ReadError

LARGEST_DROP = 4 << 30  # Largest size of a dropped file (bytes). Larger files are opened where they are.


def too_large(size: int) -> ReadError:
    """Return the error for a dropped file that is too large."""
    return ReadError(
        f"a dropped file may have {LARGEST_DROP >> 30} GiB, and this one has {size / 2**30:.1f} GiB or more",
        code="too-large", advice="Open it by its path instead.",
    )  # fmt: skip


@dataclass(frozen=True)
class Folders:
    """The folder that the user opened, and a temporary folder for dropped files, both without symbolic links."""

    root: Path
    dropped: Path

    def file(self, text: str) -> Path:
        """Return the path that a text names. A relative path starts in `root`."""
        return self._inside(text)

    def entries(self, text: str) -> tuple[str, list[str], list[str]]:
        """Return a folder's relative path, its folders and its files, without hidden ones and links to outside."""
        folder = self._inside(text)
        if not folder.is_dir():
            raise ReadError(f"{text} is not a folder", code="is-directory")
        names = sorted((name for name in folder.iterdir() if not name.name.startswith(".")), key=lambda name: name.name)
        inside = [name for name in names if name.resolve().is_relative_to(self.root)]
        here = folder.relative_to(self.root) if folder.is_relative_to(self.root) else Path(".")
        return (
            str(here),
            [name.name for name in inside if name.is_dir()],
            [name.name for name in inside if name.is_file()],
        )

    def store(self, name: str, content: IO[bytes]) -> Path:
        """Copy a dropped file (at most `LARGEST_DROP`) to its own temporary folder, and return its path."""
        last = re.sub(r"[\x00-\x1f\x7f\ud800-\udfff]", "_", Path(name.replace("\\", "/")).name)
        # A file system allows names of 255 bytes. The suffix can decide the format.
        short = last if len(last.encode()) <= 200 else f"{last[:40]}{Path(last).suffix[:10]}"
        target = Path(tempfile.mkdtemp(dir=self.dropped)) / (short if short not in ("", ".", "..") else "dropped")
        size = 0
        try:
            with target.open("wb") as file:
                for block in _blocks(content):
                    size += len(block)
                    if size > LARGEST_DROP:
                        raise too_large(size)
                    file.write(block)
        except BaseException:
            shutil.rmtree(target.parent, ignore_errors=True)
            raise
        return target

    def _inside(self, text: str) -> Path:
        if "\0" in text:
            raise OptionError(argument="file", expected="a path", got=text)
        path = (self.root / Path(text).expanduser()).resolve()
        if not (path.is_relative_to(self.root) or path.is_relative_to(self.dropped)):
            raise OptionError(
                f"{text} is outside the folder {self.root}", argument="file", got=text,
                advice="Start `gmwm app` with this file or its folder.",
            )  # fmt: skip
        if not path.exists():
            raise ReadError(f"{text} does not exist", argument="file", code="not-found")
        return path


def _blocks(content: IO[bytes]) -> Iterator[bytes]:
    while block := content.read(1 << 20):
        yield block
