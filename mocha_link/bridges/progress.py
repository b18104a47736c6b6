"""What a bridge has published, in a file, so that a restart loses and repeats nothing."""

from __future__ import annotations

import contextlib
import logging
import sqlite3
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from mocha_link.path_safety import check_links, made_folder

SPARE = 8  # headers of a topic that are remembered beyond its history

LOG = logging.getLogger("mocha_link")

# `handed` are the messages that were published: files of earlier versions have it, too.
_SCHEMA = """
PRAGMA journal_mode = WAL;
PRAGMA synchronous = NORMAL;
CREATE TABLE IF NOT EXISTS place (one INTEGER PRIMARY KEY, epoch TEXT, sequence INTEGER);
CREATE TABLE IF NOT EXISTS handed (
    number INTEGER PRIMARY KEY, channel TEXT NOT NULL, header TEXT NOT NULL
);
CREATE UNIQUE INDEX IF NOT EXISTS by_channel ON handed (channel, header);
"""


class Progress:
    """The place in the node's sequence, and the headers of the latest messages of every channel.

    A file that fails is reported and left alone; memory takes its place. Any thread may use it.
    """

    def __init__(self, path: Path | None = None) -> None:
        self._lock = threading.Lock()
        try:
            self._file = self._open(path)  # SQLite; in memory where the disk fails
        except (OSError, sqlite3.Error) as error:
            LOG.warning("cannot keep state in %s: %s; a restart will repeat messages", path, error)
            self._file = self._open(None)

    @staticmethod
    def _open(path: Path | None) -> sqlite3.Connection:
        if path is not None:
            made_folder(path.parent)
            check_links(path)
        file = sqlite3.connect(str(path or ":memory:"), check_same_thread=False)
        try:
            file.executescript(_SCHEMA)
        except sqlite3.Error:
            file.close()
            raise
        return file

    @property
    def place(self) -> tuple[str, int] | None:
        """Where to go on in the node's sequence; None: from the beginning."""
        rows = self._run(("SELECT epoch, sequence FROM place", ()))
        return (rows[0][0], rows[0][1]) if rows else None

    def published(self, channel: str, header: str) -> bool:
        """Whether a message was published before."""
        query = "SELECT 1 FROM handed WHERE channel = ? AND header = ?"
        return bool(self._run((query, (channel, header))))

    def note(self, channel: str, header: str, history: int = 1) -> None:
        """Note a message that was published, or is not worth another try."""
        forget = (
            "DELETE FROM handed WHERE channel = ?1 AND number <= (SELECT number FROM handed "
            "WHERE channel = ?1 ORDER BY number DESC LIMIT 1 OFFSET ?2)"
        )
        self._run(
            ("INSERT OR IGNORE INTO handed (channel, header) VALUES (?, ?)", (channel, header)),
            (forget, (channel, history + SPARE)),
        )

    def move(self, place: tuple[str, int]) -> None:
        """Note a place up to which all was published."""
        self._run(("INSERT OR REPLACE INTO place VALUES (1, ?, ?)", place))

    def close(self) -> None:
        """Give up the file."""
        with self._lock:
            self._file.close()

    def _run(self, *statements: tuple[str, tuple[object, ...]]) -> list[Any]:
        """Run statements together; returns the rows of the last."""
        with self._lock:
            try:
                return self._together(statements)
            except sqlite3.Error as error:
                LOG.warning("cannot use state: %s; a restart will repeat messages", error)
            failed, self._file = self._file, self._open(None)
            with contextlib.suppress(sqlite3.Error), contextlib.closing(failed):
                failed.backup(self._file)
                return self._together(statements)
            self._file = self._open(None)  # nothing of it can be used
            return self._together(statements)

    def _together(self, statements: Sequence[tuple[str, tuple[object, ...]]]) -> list[Any]:
        with self._file:
            return [self._file.execute(*each).fetchall() for each in statements][-1]
