"""Read SQLite databases, which ROS 2 records. They have a table of topics and a table of messages."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import closing
from struct import Struct
from typing import TYPE_CHECKING

from gmwm.base.errors import ReadError
from gmwm.files.contract import damage_error
from gmwm.files.formats.bagfiles import (
    BATCH_BYTES,
    CHUNK_LIMIT,
    TEXT_LIMIT,
    TOPIC_LIMIT,
    Batch,
    Storage,
    Topic,
    merge_topics,
)

if TYPE_CHECKING:
    import sqlite3

MAGIC = b"SQLite format 3\0"
_PAGE, _WORD = Struct(">H"), Struct(">I")
_FIRST, _MOST = 256, 1 << 11  # rows in the first and the largest batch; Python reuses memory of small batches


class SqliteStorage(Storage):
    """One file of a ROS 2 bag in SQLite."""

    def topics(self) -> tuple[Topic, ...]:
        """Return the topics. Since ROS 2 Iron, a second table contains the definitions of their types."""
        import sqlite3

        with closing(self._connect()) as base:
            try:
                texts = {}
                if self._table(base, "message_definitions"):
                    query = "SELECT topic_type, encoding, encoded_message_definition FROM message_definitions LIMIT ?"
                    texts = {name: (text, kind) for name, kind, text in base.execute(query, (TOPIC_LIMIT,))}
                rows = base.execute(
                    "SELECT id, name, type, serialization_format FROM topics ORDER BY id LIMIT ?", (TOPIC_LIMIT,)
                ).fetchall()
            except (sqlite3.Error, UnicodeDecodeError) as error:
                raise damage_error(f"{self.path} is damaged ({error})") from error
        topics = []
        for number, name, kind, encoding in rows:
            text, language = texts.get(kind, ("", ""))
            if (
                not all(isinstance(item, str) for item in (name, kind, encoding, text, language))
                or len(text) > TEXT_LIMIT
            ):
                raise damage_error(f"{self.path} is damaged: its table of topics does not hold texts")
            topics.append(Topic(name=name, type=kind, encoding=encoding, text=text, language=language, ids=(number,)))
        return merge_topics(iter(topics))

    def batches(self, topic: Topic) -> Iterator[Batch]:
        """Yield the messages of a topic, by time of recording if the table has an index for it, else by number."""
        import sqlite3

        marks = ",".join("?" * len(topic.ids))
        with closing(self._connect()) as base:
            try:
                order = "timestamp" if _has_time_index(base) else "id"
                rows = base.execute(
                    f"SELECT timestamp, data FROM messages WHERE topic_id IN ({marks}) ORDER BY {order}", topic.ids
                )
                count = _FIRST
                while batch := rows.fetchmany(count):
                    times, messages = (list(column) for column in zip(*batch, strict=True))
                    if set(map(type, messages)) != {bytes} or set(map(type, times)) != {int}:
                        raise damage_error(
                            f"{self.path} is damaged: a message without bytes or time", "message-damaged"
                        )
                    yield times, messages
                    count = max(1, min(_MOST, BATCH_BYTES * len(messages) // max(1, sum(map(len, messages)))))
            except (sqlite3.Error, UnicodeDecodeError) as error:
                raise damage_error(f"{self.path} is damaged ({error})") from error

    def _connect(self) -> sqlite3.Connection:
        """Open the database read-only, with settings for untrusted files."""
        import sqlite3

        log = self.path.with_name(self.path.name + "-wal")
        # If there is a write-ahead log next to the file, the file alone contains only a part of the recording.
        frozen = "" if log.exists() and log.stat().st_size else "&immutable=1"
        if frozen:
            self._require_whole()
        try:
            base = sqlite3.connect(f"{self.path.absolute().as_uri()}?mode=ro{frozen}", uri=True)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise damage_error(f"{self.path} is damaged ({error})") from error
        try:
            # The error messages of SQLite about a damaged table can contain invalid text; these errors are caught too.
            base.text_factory = lambda text: text.decode("utf-8", "replace")
            if sys.version_info >= (3, 11):  # before, the limit of SQLite, 1 GB, remains
                base.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, CHUNK_LIMIT)
            base.execute("PRAGMA trusted_schema=OFF")
            if not all(self._table(base, name) for name in ("topics", "messages")):
                raise ReadError(
                    f"{self.path} is an SQLite database without the tables topics and messages: no recording of ROS 2",
                    code="no-recording",
                    advice="Pass a recording of ROS 2.",
                )
        except (sqlite3.Error, UnicodeDecodeError, ReadError) as error:
            base.close()
            if isinstance(error, ReadError):
                raise
            raise damage_error(f"{self.path} is damaged ({error})") from error
        return base

    def _require_whole(self) -> None:
        """Raise an error if the file is shorter than its header states; SQLite would accept it."""
        with self.path.open("rb") as file:
            head = file.read(100)
        if len(head) < 100:
            raise damage_error(f"{self.path} is truncated: {len(head)} bytes are not a complete database", "cut-off")
        (size,) = _PAGE.unpack_from(head, 16)
        changed, count, valid = (_WORD.unpack_from(head, k)[0] for k in (24, 28, 92))
        size = 65536 if size == 1 else size
        available = self.path.stat().st_size
        if valid == changed and available < size * count:
            raise damage_error(f"{self.path} is truncated: {available} bytes, expected {size * count}", "cut-off")

    @staticmethod
    def _table(base: sqlite3.Connection, name: str) -> bool:
        """Return whether the database has this table. A view is refused, because it could run arbitrary SQL."""
        query = "SELECT sql FROM sqlite_master WHERE type = 'table' AND name = ?"
        row = base.execute(query, (name,)).fetchone()
        return row is not None and str(row[0]).upper().startswith("CREATE TABLE")


def _has_time_index(base: sqlite3.Connection) -> bool:
    """Return whether the messages have an index by time; sorting without one needs as much space as the file."""
    for row in base.execute("PRAGMA index_list(messages)").fetchall():
        columns = base.execute("SELECT name FROM pragma_index_info(?)", (row[1],)).fetchall()
        if columns and columns[0][0] == "timestamp":
            return True
    return False
