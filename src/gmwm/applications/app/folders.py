"""Access to the files that the page may open: files in the opened folder, and files dropped on the page."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from gmwm.base.errors import OptionError, ReadError


@dataclass(frozen=True)
class Folders:
    """The folder that the user opened, and a temporary folder for dropped files.

    Attributes
    ----------
    root : Path
        The folder that the user opened, with symbolic links resolved.
    dropped : Path
        The temporary folder, with symbolic links resolved.
    """

    root: Path
    dropped: Path

    def file(self, text: str) -> Path:
        """Return the path that a text names. A relative path starts in `root`."""
        return self._inside(text)

    def entries(self, text: str) -> tuple[str, list[str], list[str]]:
        """Return the path of a folder relative to `root`, the names of its folders, and the names of its files.

        Hidden files and links to files outside `root` are left out.
        """
        folder = self._inside(text)
        if not folder.is_dir():
            raise ReadError(f"{text} is not a folder", code="is-directory")
        names = sorted((name for name in folder.iterdir() if not name.name.startswith(".")), key=lambda name: name.name)
        inside = [name for name in names if self._is_inside(name)]
        here = folder.relative_to(self.root) if folder.is_relative_to(self.root) else Path(".")
        return (
            str(here),
            [name.name for name in inside if name.is_dir()],
            [name.name for name in inside if name.is_file()],
        )

    def store(self, name: str, content: IO[bytes]) -> Path:
        """Copy a dropped file to the temporary folder, and return its path."""
        last = Path(name.replace("\\", "/")).name
        target = self.dropped / (last if last not in ("", "..") else "dropped")
        with target.open("wb") as file:
            for block in _blocks(content):
                file.write(block)
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

    def _is_inside(self, path: Path) -> bool:
        return path.resolve().is_relative_to(self.root)


def _blocks(content: IO[bytes]) -> Iterator[bytes]:
    while block := content.read(1 << 20):
        yield block
