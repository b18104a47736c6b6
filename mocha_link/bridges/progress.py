"""What a bridge has handed on, kept in a file so that a restart loses and repeats nothing."""

from __future__ import annotations

import logging
import sqlite3
import threading
from pathlib import Path

SPARE = 8  # headers of a topic that are remembered beyond its history

LOG = logging.getLogger("mocha_link")

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

    A file that cannot be used is reported and left alone; then nothing is remembered beyond the
    process. Any thread may use it.
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
            path.parent.mkdir(parents=True, exist_ok=True)
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
        with self._lock:
            row = self._file.execute("SELECT epoch, sequence FROM place").fetchone()
        return (row[0], row[1]) if row else None

    def handed(self, channel: str, header: str) -> bool:
        """Whether a message was handed on before."""
        query = "SELECT 1 FROM handed WHERE channel = ? AND header = ?"
        with self._lock:
            return self._file.execute(query, (channel, header)).fetchone() is not None

    def note(self, channel: str, header: str, history: int = 1) -> None:
        """A message was handed on, or is not worth another try."""
        with self._lock, self._file:
            self._file.execute(
                "INSERT OR IGNORE INTO handed (channel, header) VALUES (?, ?)", (channel, header)
            )
            self._file.execute(
                "DELETE FROM handed WHERE channel = ?1 AND number <= (SELECT number FROM handed "
                "WHERE channel = ?1 ORDER BY number DESC LIMIT 1 OFFSET ?2)",
                (channel, history + SPARE),
            )

    def move(self, place: tuple[str, int]) -> None:
        """All up to a place was handed on."""
        with self._lock, self._file:
            self._file.execute("INSERT OR REPLACE INTO place VALUES (1, ?, ?)", place)

    def close(self) -> None:
        """Give up the file."""
        with self._lock:
            self._file.close()
