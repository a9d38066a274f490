"""Write files atomically, which means completely or not at all, and read JSON."""

from __future__ import annotations

import errno
import glob
import json
import os
import platform
import shutil
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

_WINDOWS = os.name == "nt"
_OPEN_ELSEWHERE_S = 2.0
"""Time for which a file is tried again that another program has open on Windows. A virus scanner needs less."""


def _prefix(process: int | str) -> str:
    """Return the beginning of the names of temporary files and folders of a process of this machine."""
    return f".writing-{platform.node() or 'localhost'}-{process}-"


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


def _remove_leftovers(folder: Path) -> None:
    """Remove what killed processes of this machine left; Windows does not tell whether a process lives."""
    if _WINDOWS:
        return
    for path in folder.glob(glob.escape(_prefix("")[:-1]) + "*"):
        process = path.name.removeprefix(_prefix("")[:-1]).partition("-")[0]
        if process.isdecimal() and not _is_alive(int(process)):
            if path.is_dir():
                shutil.rmtree(path, ignore_errors=True)
            else:
                path.unlink(missing_ok=True)


def _is_special(path: Path) -> bool:
    """Return whether a path is a pipe or a device, which renaming a file would replace."""
    return path.exists() and not path.is_file() and not path.is_dir()


def _replace(source: Path, target: Path) -> None:
    """Rename `source` to `target`, which may exist; a pipe or a device stays, and gets the content."""
    if _is_special(target):
        with source.open("rb") as content, target.open("wb") as stream:
            shutil.copyfileobj(content, stream)
        source.unlink()
        return
    end = time.monotonic() + _OPEN_ELSEWHERE_S
    while True:
        try:
            source.replace(target)
            return
        except PermissionError as error:
            if not _WINDOWS or target.is_dir():
                raise
            if time.monotonic() > end:
                raise PermissionError(
                    error.errno, "the file is open in another program; close it there", str(target)
                ) from error
            time.sleep(0.05)


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path with the suffix of `path`, and rename it to this if the block succeeds."""
    target = Path(path)
    folder: Path | None = None  # a pipe or a device may be in a folder that only root can write to
    if not _is_special(target):
        if target.is_symlink():
            target = target.resolve()  # the link stays, and its file is replaced
        folder = target.parent
        _remove_leftovers(folder)
    try:
        handle, name = tempfile.mkstemp(prefix=_prefix(os.getpid()), suffix=target.suffix, dir=folder)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(target)) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        _replace(temporary, target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        # For example, the disk is full. The user knows `path`, not the temporary name.
        if isinstance(error, OSError) and error.filename in (None, name):
            raise OSError(error.errno or errno.EIO, error.strerror or str(error), str(target)) from error
        if type(error).__module__.startswith("polars"):
            raise OSError(errno.EIO, str(error).splitlines()[0], str(target)) from error
        raise


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Yield a temporary folder, and move its files to `folder` if the block succeeds, so that runs are never mixed."""
    _remove_leftovers(folder)
    temporary = Path(tempfile.mkdtemp(prefix=_prefix(os.getpid()), dir=folder))
    try:
        yield temporary
        for file in sorted(temporary.iterdir()):
            try:
                _replace(file, folder / file.name)
            except OSError as error:
                raise OSError(error.errno, error.strerror, str(folder / file.name)) from error
    except OSError as error:
        if error.errno is not None and error.filename and Path(error.filename).parent == temporary:
            raise OSError(error.errno, error.strerror, str(folder / Path(error.filename).name)) from error
        raise
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` in UTF-8, completely or not at all; other bytes of file names become \\udc.., as JSON reads them."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8", errors="backslashreplace")


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write `content` to `path`, completely or not at all."""
    with written_whole(path) as temporary:
        temporary.write_bytes(content)


DEEPEST_DOCUMENT = 64  # largest depth of a JSON document; gmwm's have ten levels, and very deep ones overflow the stack


def read_json(path: str | os.PathLike[str]) -> Any:
    """Read a JSON file. Raises ValueError if it is not UTF-8 or JSON, too deeply nested, or has a non-finite number."""
    try:
        content = json.loads(Path(path).read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError(f"lists or objects are nested more than {DEEPEST_DOCUMENT} deep") from None
    layer = [content] if isinstance(content, dict | list) else []
    for _ in range(DEEPEST_DOCUMENT):
        inside = [item for parent in layer for item in (parent.values() if isinstance(parent, dict) else parent)]
        # Smallest whole number that is infinite as a floating-point number.
        if not all(abs(item) < (1 << 1024) for item in inside if isinstance(item, int | float)):
            raise ValueError("a number is not finite")
        layer = [item for item in inside if isinstance(item, dict | list)]
    if layer:
        raise ValueError(f"lists or objects are nested more than {DEEPEST_DOCUMENT} deep")
    return content
