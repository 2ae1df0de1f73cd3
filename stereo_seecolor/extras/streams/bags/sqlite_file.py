"""ROS 2 bags in SQLite (.db3), row by row."""

import contextlib
import sqlite3
from collections.abc import Callable, Iterator
from pathlib import Path

from stereo_seecolor.extras.streams.bags.source import Channel, Message, Place

SQLITE_MAGIC = b"SQLite format 3\x00"
HEAD_BYTES = 64
"""Of each message so much is read while the file is walked: enough for a header's time."""


def connect(path: Path) -> sqlite3.Connection:
    """The file, opened for reading; nothing is written beside it. Raises sqlite3.Error.

    A recorder that was killed leaves a journal with the last messages, which only an ordinary
    connection reads. A file that was cut is read as far as it goes, which SQLite does only with
    writable_schema (nothing is written: the connection is for reading).
    """
    journal = path.with_name(f"{path.name}-wal").exists()
    database = sqlite3.connect(
        f"{path.absolute().as_uri()}?mode=ro{'' if journal else '&immutable=1'}", uri=True
    )
    database.execute("PRAGMA writable_schema = ON")
    return database


def walk_sqlite(path: Path, problems: list[str]) -> Iterator[Message]:
    """Iterate over the messages in the order of the file, as far as it can be read. What is wrong
    with it is added to ``problems``.

    place: its start is the number of the row.
    """
    try:
        with contextlib.closing(connect(path)) as database:
            channels = {
                number: Channel(str(topic), str(msgtype), str(encoding))
                for number, topic, msgtype, encoding in database.execute(
                    "SELECT id, name, type, serialization_format FROM topics"
                )
            }
            rows = database.execute(
                "SELECT id, topic_id, timestamp, length(data), substr(data, 1, ?) FROM messages "
                "ORDER BY id",
                (HEAD_BYTES,),
            )
            for row, number, time_ns, size, head in rows:
                if number in channels and isinstance(head, bytes):
                    yield Message(channels[number], int(time_ns), Place(row, size), _first(head))
    except (sqlite3.Error, OverflowError, ValueError) as error:
        problems.append(f"cannot be read further: {error}")


def read(path: Path, row: int) -> bytes:
    """Read one message. Raises sqlite3.Error; KeyError where it is gone."""
    with contextlib.closing(connect(path)) as database:
        found = database.execute("SELECT data FROM messages WHERE id = ?", (row,)).fetchone()
    if found is None:
        raise KeyError(row)
    return bytes(found[0])


def _first(head: bytes) -> Callable[[int], bytes]:
    return lambda most: head[:most]
