"""Files are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def written_whole(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path beside `path`; it takes the name `path` only if the block ends without an error.

    The temporary file keeps the suffix of `path`, since writers choose a format by it.
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(target)) from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        umask = os.umask(0)
        os.umask(umask)
        temporary.chmod(0o666 & ~umask)
        temporary.replace(target)
    except BaseException as error:
        temporary.unlink(missing_ok=True)
        if isinstance(error, OSError) and error.errno is not None and error.filename in (None, name):
            # As of a disk that is full: the name is that of the file that was wanted.
            raise OSError(error.errno, error.strerror, str(target)) from error
        raise


@contextmanager
def written_together(folder: Path) -> Iterator[Path]:
    """Yield a folder for files that belong together; they go to `folder` if the block ends without an error.

    So no file of this run stands beside those of an earlier one where it was interrupted.
    """
    room = Path(tempfile.mkdtemp(prefix=".writing-", dir=folder))
    try:
        yield room
        for file in sorted(room.iterdir()):
            try:
                file.replace(folder / file.name)
            except OSError as error:
                raise OSError(error.errno, error.strerror, str(folder / file.name)) from error
    except OSError as error:
        if error.errno is not None and error.filename and Path(error.filename).parent == room:
            raise OSError(error.errno, error.strerror, str(folder / Path(error.filename).name)) from error
        raise
    finally:
        shutil.rmtree(room, ignore_errors=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Write `text` to `path` in UTF-8, whole or not at all."""
    with written_whole(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
